#!/usr/bin/env python3
"""A cRIO in plain Python, written from the wire protocol's page alone.

It shares no line with the Rust programs: if both ends misread the page in the same way, only a third reading tells.
It plays the cRIO in real time (50 Hz), checks every byte that the daemon sends, and prints one JSON object when it
is done. The first line is `listening PORT`.

The plant behind it is deliberately not the rig's model: two first-order lags toward settled pressures that are
linear in the duties, a least-squares fit of the settled pressures below.

Left out: noise, the converter's steps, lockstep.
"""

import argparse
import json
import math
import select
import socket
import struct
import time
import zlib

MAGIC, VERSION = 0x504E4555, 1
HELLO, SENSE, COMMAND, BYE = 1, 2, 3, 4
LENGTHS = {HELLO: 52, SENSE: 64, COMMAND: 44, BYE: 32}
RATE_MHZ = 50_000
PERIOD_S = 0.02
TRIP_KPA = 300.0
IDLE, RUNNING, HOLDING, TRIPPED = 0, 1, 2, 3
OVER_PRESSURE, COMMAND_LOST = 1, 2
# How long a fault at a sensor lasts, in ticks: longer than the two within which the daemon must answer.
FAULT_TICKS = 10

# Settled pressures (kPa gauge) of the paper's rig: (u_pos, u_neg) -> (positive, negative).
SETTLED = [
    (0.6, 0.6, 110.7, -80.7), (0.6, 0.7, 120.2, -75.8), (0.6, 0.8, 129.2, -70.9), (0.6, 0.9, 137.7, -66.0), (0.6, 1.0, 145.7, -61.2),
    (0.8, 0.6, 74.7, -81.2), (0.8, 0.7, 85.2, -76.3), (0.8, 0.8, 95.0, -71.4), (0.8, 0.9, 104.2, -66.6), (0.8, 1.0, 112.8, -61.8),
    (1.0, 0.6, 44.4, -81.7), (1.0, 0.7, 54.8, -76.8), (1.0, 0.8, 64.6, -72.0), (1.0, 0.9, 73.9, -67.2), (1.0, 1.0, 82.8, -62.4),
]


def fit_plane(column):
    """Least squares of a + b u_pos + c u_neg, by the normal equations and Gauss-Jordan."""
    rows = [(1.0, r[0], r[1], r[column]) for r in SETTLED]
    system = [[sum(r[i] * r[j] for r in rows) for j in range(4)] for i in range(3)]
    for i in range(3):
        pivot = system[i][i]
        system[i] = [x / pivot for x in system[i]]
        for k in range(3):
            if k != i:
                factor = system[k][i]
                system[k] = [x - factor * y for x, y in zip(system[k], system[i])]
    return [row[3] for row in system]


class Plant:
    """Two chambers, each a first-order lag about as quick as the real one: the pump moves 15 L/s through 0.75 and 0.4 L."""

    LAG_S = [0.2, 0.08]

    def __init__(self):
        self.planes = [fit_plane(2), fit_plane(3)]
        self.kpa = [0.0, 0.0]

    def step(self, duty, pump_on, seconds):
        for c in range(2):
            if pump_on:
                a, b_pos, b_neg = self.planes[c]
                settled, lag_s = a + b_pos * duty[0] + b_neg * duty[1], self.LAG_S[c]
            else:
                # Without the pump a chamber only loses what its vent lets through.
                settled, lag_s = 0.0, 0.5 / max(duty[c], 0.01)
            self.kpa[c] += (settled - self.kpa[c]) * (1.0 - math.exp(-seconds / lag_s))

    def volts(self):
        # 1-5 V: 0 ... 1000 kPa gauge, and 0 ... -101 kPa gauge.
        return [1.0 + 4.0 * self.kpa[0] / 1000.0, 1.0 + 4.0 * self.kpa[1] / -101.0, math.nan, math.nan]


class Violation(Exception):
    """The daemon sent what the page does not allow."""


def sealed(body):
    return body + struct.pack(">I", zlib.crc32(body))


def header(kind, sequence, version=VERSION):
    return struct.pack(">IBBHIQ", MAGIC, version, kind, LENGTHS[kind], sequence, time.monotonic_ns())


def check_header(frame):
    """Kind, sequence and clock of a whole frame."""
    magic, version, kind, length, sequence, clock = struct.unpack_from(">IBBHIQ", frame)
    if magic != MAGIC or version != VERSION:
        raise Violation(f"magic {magic:08X} version {version}")
    if kind not in (HELLO, COMMAND, BYE) or length != LENGTHS[kind]:
        raise Violation(f"type {kind} with length {length}")
    crc = struct.unpack_from(">I", frame, length - 4)[0]
    if crc != zlib.crc32(frame[: length - 4]):
        raise Violation(f"type {kind}: CRC {crc:08X} instead of {zlib.crc32(frame[: length - 4]):08X}")
    return kind, sequence, clock


class Session:
    """One connection, from the daemon's HELLO to its end."""

    def __init__(self, crio, connection):
        self.crio, self.connection, self.options = crio, connection, crio.options
        self.buffer = b""
        self.sent, self.received, self.last_clock = 0, 0, 0
        self.session = None
        self.tick = -1
        self.last_edge, self.held_up_s = time.monotonic(), 0.0
        self.in_force, self.duty, self.mode, self.ttl, self.pump_on = 0, [1.0, 1.0], 0, 2, False
        self.last_command_tick, self.answered = None, -1
        self.trips, self.missed, self.age = 0, 0, 0
        self.ended = None
        # Faults come once, in the first session that gets that far.
        self.note = {"session": None, "name": None, "ticks": 0, "commands": 0, "late_answers": 0, "ahead_answers": 0,
                     "first_run_tick": None, "bye_reason": None, "ended": None, "trips": 0, "last_command": None,
                     "max_step_ms": 0.0}
        crio.report["sessions"].append(self.note)

    # --- out -------------------------------------------------------------------------------------------------

    def send(self, kind, body, spoil=False, version=VERSION):
        self.sent = self.sent % 0xFFFFFFFF + 1
        frame = sealed(header(kind, self.sent, version) + body)
        if spoil:
            frame = frame[:33] + bytes([frame[33] ^ 0x10]) + frame[34:]
        self.connection.sendall(frame)

    def send_bye(self, reason):
        try:
            self.send(BYE, struct.pack(">IB3x", self.session or 0, reason))
        except OSError:
            pass

    def send_sense(self):
        volts, o, k = self.crio.plant.volts(), self.options, self.tick

        def active(at):
            return at is not None and self.crio.faulty is self and at <= k < at + FAULT_TICKS

        if active(o.nan_at):
            volts[0] = math.nan
        if active(o.broken_sensor_at):
            volts[1] = 0.31
        if active(o.overpressure_at):
            volts[0] = 1.0 + 4.0 * 250.0 / 1000.0
        lost = o.lose_from is not None and self.crio.faulty is self and o.lose_from <= k < o.lose_from + o.lose_count
        lost = lost and (k - o.lose_from) % o.lose_every == 0
        if lost:
            return
        state = TRIPPED if self.trips else {0: IDLE, 1: RUNNING, 2: HOLDING}[self.mode]
        flags = state | (0x80 if self.pump_on else 0)
        body = struct.pack(">III4f2fBBH", self.session, k, self.in_force, *volts, *self.duty, flags, self.trips, min(self.missed, 0xFFFF))
        self.send(SENSE, body, spoil=self.crio.faulty is self and o.bad_crc_at == k)

    # --- in --------------------------------------------------------------------------------------------------

    def read(self):
        """Takes what has come; False at the end of the stream."""
        data = self.connection.recv(4096)
        if not data:
            return False
        self.buffer += data
        while len(self.buffer) >= 8:
            length = struct.unpack_from(">H", self.buffer, 6)[0]
            if length not in LENGTHS.values():
                raise Violation(f"no frame has the length {length}")
            if len(self.buffer) < length:
                break
            frame, self.buffer = self.buffer[:length], self.buffer[length:]
            self.take(frame)
        if self.buffer:
            # One write per frame: over loopback a frame never comes in two parts.
            self.crio.report["partial_reads"] += 1
        return True

    def take(self, frame):
        kind, sequence, clock = check_header(frame)
        if self.ended == "bye":
            raise Violation(f"type {kind} after BYE")
        if sequence != self.received + 1:
            raise Violation(f"sequence {sequence} after {self.received}")
        if clock <= self.last_clock:
            raise Violation(f"clock {clock} after {self.last_clock}")
        self.received, self.last_clock = sequence, clock
        if (kind == HELLO) != (self.session is None):
            raise Violation(f"type {kind} {'before' if self.session is None else 'after'} HELLO")
        {HELLO: self.take_hello, COMMAND: self.take_command, BYE: self.take_bye}[kind](frame)

    def take_hello(self, frame):
        session, rate, sensors, valves, low, high, name = struct.unpack_from(">IIBBBB16s", frame, 20)
        if session == 0 or session in self.crio.seen:
            raise Violation(f"session {session} is not fresh")
        if rate != RATE_MHZ or sensors < 2 or valves < 2 or not low <= VERSION <= high:
            raise Violation(f"HELLO rate {rate} sensors {sensors} valves {valves} versions {low}-{high}")
        text = name.rstrip(b"\0")
        if not text or not all(32 <= b < 127 for b in text):
            raise Violation(f"HELLO name {name!r}")
        self.crio.seen.add(session)
        self.session = session
        self.note["session"], self.note["name"] = session, text.decode()

    def take_command(self, frame):
        session, tick, u_pos, u_neg, mode, ttl, digital, zero = struct.unpack_from(">IIffBBBB", frame, 20)
        if session != self.session:
            raise Violation(f"COMMAND of session {session:08X}")
        if not all(math.isfinite(u) and 0.0 <= u <= 1.0 for u in (u_pos, u_neg)):
            raise Violation(f"duty {u_pos} {u_neg}")
        if mode not in (0, 1, 2) or not 1 <= ttl <= 5 or digital & ~1 or zero:
            raise Violation(f"mode {mode} ttl {ttl} digital {digital} reserved {zero}")
        # A tick whose frame did not come is answered under the number it would have had: never earlier than its time.
        # Where this program was held up, its own numbers lag behind that time.
        behind = self.held_up_s + time.monotonic() - self.last_edge
        if tick < self.answered or tick > self.tick + 1 + int(behind / PERIOD_S):
            raise Violation(f"COMMAND answers tick {tick} at tick {self.tick}, after {self.answered}")
        self.note["late_answers"] += tick < self.tick
        self.note["ahead_answers"] += tick > self.tick
        if tick <= self.tick:
            self.answered = tick
        self.note["commands"] += 1
        self.note["last_command"] = {"tick": tick, "duty": [u_pos, u_neg], "mode": mode, "pump_on": digital & 1}
        self.crio.saw_command(self, tick, u_pos, u_neg, mode)
        if mode == 1 and self.note["first_run_tick"] is None:
            self.note["first_run_tick"] = tick
        if self.trips:
            return
        self.in_force, self.ttl, self.age = self.received, ttl, 0
        self.duty, self.mode, self.pump_on = [u_pos, u_neg], mode, bool(digital & 1)

    def take_bye(self, frame):
        session, reason = struct.unpack_from(">IB", frame, 20)
        if session != self.session or reason > 4 or frame[25:28] != b"\0\0\0":
            raise Violation(f"BYE session {session:08X} reason {reason} reserved {frame[25:28]!r}")
        self.note["bye_reason"] = reason
        self.ended = "bye"

    # --- time ------------------------------------------------------------------------------------------------

    def edge(self):
        """One sample edge."""
        self.crio.plant.step(self.duty, self.pump_on, PERIOD_S)
        self.tick += 1
        self.age += 1
        # The command of a tick counts for it; `age` is 1 at an edge that follows a tick with one.
        if self.age > 1 and self.in_force:
            self.missed += 1
            if self.age > self.ttl:
                self.trips |= COMMAND_LOST
        if self.crio.plant.kpa[0] > TRIP_KPA:
            self.trips |= OVER_PRESSURE
        if self.trips:
            self.duty, self.mode, self.pump_on = [1.0, 1.0], 0, False
        self.note["trips"], self.note["ticks"] = self.trips, self.tick + 1
        self.crio.saw_edge(self)
        self.send_sense()

    def wait_until(self, deadline):
        """Serves the socket until then; False when the session is over."""
        while True:
            left = deadline - time.monotonic()
            if left <= 0:
                return True
            if select.select([self.connection], [], [], left)[0]:
                if not self.read():
                    self.ended = self.ended or "closed without BYE"
                if self.ended:
                    return False

    def run(self):
        o = self.options
        deadline = time.monotonic() + 2.0
        while self.session is None:
            if not select.select([self.connection], [], [], max(0.0, deadline - time.monotonic()))[0] or not self.read():
                self.ended = "no HELLO"
                return
        low = high = o.version
        self.send(HELLO, struct.pack(">IIBBBB16s", self.session, RATE_MHZ, 4, 2, low, high, b"independent"), version=o.header_version)
        self.crio.started = self.crio.started or time.monotonic()
        following = time.monotonic() + PERIOD_S
        while self.wait_until(following):
            if time.monotonic() - self.crio.started > o.seconds:
                self.send_bye(0)
                self.ended = "time"
                return
            late = time.monotonic() - following
            self.note["max_step_ms"] = max(self.note["max_step_ms"], 1000.0 * late)
            # After a stall of this machine ticks are not made up for: no rig has them.
            following += PERIOD_S if late < PERIOD_S else late + PERIOD_S
            self.last_edge, self.held_up_s = time.monotonic(), late
            self.edge()
            if o.drop_link_at == self.tick and self.crio.faulty is self:
                self.ended = "dropped"
                return


class Crio:
    """Listens, serves one daemon after the other, and keeps the report."""

    def __init__(self, options):
        self.options, self.plant, self.seen = options, Plant(), set()
        self.started, self.faulty = None, None
        at = (options.lose_from, options.nan_at, options.broken_sensor_at, options.overpressure_at)
        self.fault_tick = next((t for t in at if t is not None), None)
        self.report = {"sessions": [], "violations": [], "partial_reads": 0, "seconds": [], "max_pos_kpa": 0.0, "min_neg_kpa": 0.0,
                       "vent": None, "run_commands_before_fault": 0, "run_commands_after_fault": 0}

    def saw_command(self, session, tick, u_pos, u_neg, mode):
        report = self.report
        if session is not self.faulty or self.fault_tick is None:
            return
        if tick < self.fault_tick:
            report["run_commands_before_fault"] += mode == 1
        elif mode == 0 and u_pos == 1.0 and u_neg == 1.0:
            report["vent"] = report["vent"] or {"answered_tick": tick, "at_tick": session.tick}
        elif report["vent"] is None:
            report["run_commands_after_fault"] += 1

    def saw_edge(self, session):
        report, (pos, neg) = self.report, self.plant.kpa
        report["max_pos_kpa"], report["min_neg_kpa"] = max(report["max_pos_kpa"], pos), min(report["min_neg_kpa"], neg)
        if session.tick % 50 == 49:
            report["seconds"].append({"session": len(report["sessions"]), "tick": session.tick, "p_pos_kpa": pos, "p_neg_kpa": neg,
                                      "u_pos": session.duty[0], "u_neg": session.duty[1], "mode": session.mode})

    def over(self):
        return self.started is not None and time.monotonic() - self.started > self.options.seconds

    def serve(self, listener):
        parted = time.monotonic()
        give_up = time.monotonic() + self.options.patience
        while not self.over() and (self.started or time.monotonic() < give_up):
            if not select.select([listener], [], [], 0.1)[0]:
                continue
            connection, _ = listener.accept()
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # In between no command came: vents open, pump off.
            self.plant.step([1.0, 1.0], False, time.monotonic() - parted)
            session = Session(self, connection)
            self.faulty = self.faulty or session
            try:
                session.run()
            except Violation as violation:
                self.report["violations"].append(str(violation))
                session.send_bye(2)
                session.ended = "violation"
            except OSError as error:
                session.ended = session.ended or f"link broke: {error}"
            connection.close()
            parted = time.monotonic()
            session.note["ended"] = session.ended
            if session.ended == "violation" or session.note["bye_reason"] == 0:
                return


def arguments():
    parser = argparse.ArgumentParser(description="A cRIO in plain Python that checks what the daemon sends.")
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0, help="end this long after the first HELLO")
    parser.add_argument("--patience", type=float, default=60.0, help="how long to wait for the first daemon, s")
    parser.add_argument("--lose-from", type=int, help="from this tick on SENSE frames are not sent ...")
    parser.add_argument("--lose-count", type=int, default=1, help="... so many of them")
    parser.add_argument("--lose-every", type=int, default=1, help="... of which every so-manieth is lost")
    parser.add_argument("--period-ms", type=float, default=20.0, help="between samples; 20 is what a sound cRIO has")
    for fault in ("--drop-link-at", "--nan-at", "--broken-sensor-at", "--overpressure-at", "--bad-crc-at"):
        parser.add_argument(fault, type=int, metavar="TICK")
    parser.add_argument("--version", type=int, default=VERSION, help="the only version offered in HELLO")
    parser.add_argument("--header-version", type=int, default=VERSION, help="version in the header of HELLO")
    return parser.parse_args()


def main():
    global PERIOD_S
    options = arguments()
    PERIOD_S = options.period_ms / 1000.0
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", options.port))
    listener.listen(4)
    print(f"listening {listener.getsockname()[1]}", flush=True)
    crio = Crio(options)
    crio.serve(listener)
    print(json.dumps(crio.report), flush=True)


if __name__ == "__main__":
    main()
