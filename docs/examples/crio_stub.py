"""A cRIO in 60 lines, written from docs/protocol.md: the daemon connects, arms and controls a toy of a plant.

    python3 crio_stub.py PORT [--lockstep]

Prints the port it listens on (0 picks one). Valves and pump are a first-order lag toward a plane; nothing here is a
rig. With --lockstep a sample follows each command at once, without it every 20 ms.
"""
import socket, struct, sys, time, zlib

MAGIC, HELLO, SENSE, COMMAND, BYE = 0x504E4555, 1, 2, 3, 4
LENGTH = {HELLO: 52, SENSE: 64, COMMAND: 44, BYE: 32}
LOCKSTEP = "--lockstep" in sys.argv


def frame(kind, sequence, body):
    head = struct.pack(">IBBHIQ", MAGIC, 1, kind, LENGTH[kind], sequence, time.monotonic_ns())
    return head + body + struct.pack(">I", zlib.crc32(head + body))


def read(peer):
    """The next frame: type, sequence number, body. Raises EOFError at the end."""
    def exactly(n):
        data = b""
        while len(data) < n:
            piece = peer.recv(n - len(data))
            if not piece:
                raise EOFError
            data += piece
        return data
    head = exactly(20)
    magic, version, kind, length, sequence, _ = struct.unpack(">IBBHIQ", head)
    assert (magic, version, length) == (MAGIC, 1, LENGTH[kind]), "not this protocol"
    rest = exactly(length - 20)
    assert struct.unpack(">I", rest[-4:])[0] == zlib.crc32(head + rest[:-4]), "CRC"
    return kind, sequence, rest[:-4]


def serve(peer):
    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    kind, _, hello = read(peer)
    assert kind == HELLO
    session = struct.unpack(">I", hello[:4])[0]
    peer.sendall(frame(HELLO, 1, struct.pack(">IIBBBB16s", session, 50_000, 2, 2, 1, 1, b"stub")))
    p, duty, in_force, mode, pump, due = [0.0, 0.0], [1.0, 1.0], 0, 0, 0, time.monotonic()
    for tick in range(2**32):
        volts = [1 + 4 * p[0] / 1000, 1 - 4 * p[1] / 101, float("nan"), float("nan")]
        state = (1 if mode == 1 else 0) | (0x80 if pump else 0)
        body = struct.pack(">III4f2fBBH", session, tick, in_force, *volts, *duty, state, 0, 0)
        peer.sendall(frame(SENSE, tick + 2, body))
        kind, in_force, body = read(peer)
        if kind == BYE:
            return
        _, _, u_pos, u_neg, mode, _, outputs, _ = struct.unpack(">II2fBBBB", body)
        duty, pump = [u_pos, u_neg], outputs & 1
        goal = [150.6 - 161.5 * u_pos + 92.9 * u_neg, -108.0 - 2.7 * u_pos + 48.5 * u_neg] if pump else [0, 0]
        p = [now + share * (to - now) for now, to, share in zip(p, goal, (0.1, 0.22))]
        due += 0.02
        time.sleep(0 if LOCKSTEP else max(0, due - time.monotonic()))


listener = socket.create_server(("127.0.0.1", int(sys.argv[1])))
print("listening on", listener.getsockname()[1], flush=True)
while True:
    try:
        serve(listener.accept()[0])
    except (EOFError, ConnectionError):
        pass
