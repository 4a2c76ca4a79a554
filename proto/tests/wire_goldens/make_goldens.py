"""Writes goldens.txt: frames made from the protocol's tables with Python's struct and zlib alone.

Run:  python3 make_goldens.py > goldens.txt
Each line: a name, then the frame in hex. The values stand again in ../wire_goldens.rs, by hand.
"""
import struct
import zlib


def frame(kind, sequence, clock_ns, body):
    head = struct.pack(">IBBHIQ", 0x504E4555, 1, kind, 20 + len(body) + 4, sequence, clock_ns)
    return head + body + struct.pack(">I", zlib.crc32(head + body) & 0xFFFFFFFF)


def hello(sequence, clock_ns, session, rate, sensors, valves, low, high, name):
    return frame(1, sequence, clock_ns, struct.pack(">IIBBBB16s", session, rate, sensors, valves, low, high, name))


def sense(sequence, clock_ns, session, tick, in_force, volts, duty, state, pump, trips, missed):
    body = struct.pack(">III", session, tick, in_force)
    body += b"".join(v if isinstance(v, bytes) else struct.pack(">f", v) for v in volts)
    body += struct.pack(">ff", *duty)
    body += struct.pack(">BBH", state | (0x80 if pump else 0), trips, missed)
    return frame(2, sequence, clock_ns, body)


def command(sequence, clock_ns, session, tick, duty, mode, ttl, outputs):
    body = struct.pack(">II", session, tick)
    body += b"".join(d if isinstance(d, bytes) else struct.pack(">f", d) for d in duty)
    body += struct.pack(">BBBB", mode, ttl, outputs, 0)
    return frame(3, sequence, clock_ns, body)


def bye(sequence, clock_ns, session, reason):
    return frame(4, sequence, clock_ns, struct.pack(">IB3x", session, reason))


NAN = bytes.fromhex("7fc00000")

GOLDENS = {
    "hello_daemon": hello(1, 123456789, 0xDEADBEEF, 50000, 2, 2, 1, 1, b"controller"),
    "hello_full_name": hello(0xFFFFFFFF, 0xFFFFFFFFFFFFFFFF, 1, 50000, 4, 3, 1, 7, b"sixteen-letters!"),
    "sense_first": sense(2, 20000000, 0xDEADBEEF, 0, 0, [1.0, 1.0, NAN, NAN], [1.0, 1.0], 0, False, 0, 0),
    "sense_running": sense(3002, 60020000001, 0xDEADBEEF, 3000, 2999, [1.39990234375, 4.029541015625, NAN, NAN],
                           [0.75, 0.8125], 1, True, 0, 3),
    "sense_tripped": sense(7, 8, 9, 10, 11, [5.2, 0.8, 0.0, -0.5], [1.0, 1.0], 3, False, 1 | 2 | 4 | 8, 65535),
    "command_run": command(2, 20100000, 0xDEADBEEF, 0, [0.75, 0.1], 1, 2, 1),
    "command_vent": command(0x01020304, 0x0102030405060708, 0x11121314, 0x21222324, [1.0, 1.0], 0, 5, 0),
    "command_nan": command(5, 6, 7, 8, [NAN, 2.5], 2, 255, 255),
    "bye_normal": bye(3003, 60030000000, 0xDEADBEEF, 0),
    "bye_fault": bye(1, 0, 0, 4),
}

for name, data in GOLDENS.items():
    print(name, data.hex())
