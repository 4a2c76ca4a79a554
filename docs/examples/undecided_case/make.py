"""Makes the raw log of this case: a rig that nobody has, read by a logger with its own names and units.

usage: python3 make.py path/to/trainer
"""
import csv, random, subprocess, sys

trainer = sys.argv[1]
random.seed(46)


def commands(name, seconds):
    """Random holds of both vents, 0.4 to 2 s each; a slow triangle in the last third."""
    rows, level, left = [], [0.8, 0.8], [0, 0]
    for k in range(int(seconds * 50)):
        for v in (0, 1):
            if left[v] == 0:
                level[v], left[v] = 0.68 + 0.28 * random.random(), random.randint(20, 100)
            left[v] -= 1
        u = list(level)
        if k > seconds * 50 * 2 / 3:
            for v in (0, 1):
                phase = k / (300.0 + 130.0 * v) % 1.0
                u[v] = 0.8 + 0.14 * abs(2 * phase - 1)
        rows.append([k * 0.02, round(u[0], 3), round(u[1], 3), 90, -65])
    with open(name, "w", newline="") as f:
        w = csv.writer(f)
        w.writerow(["time_s", "u_pos", "u_neg", "p_pos_kpa", "p_neg_kpa"])
        w.writerows(rows)


def logged(name, seconds):
    """What the lab's logger writes: ms, per cent, bar; noise of 0.06 kPa and steps of 0.1 mbar."""
    commands("commands.tmp.csv", seconds)
    subprocess.run([trainer, "simulate", "--rig", "truth.toml", "--inputs", "commands.tmp.csv", "--out", "made.tmp.csv"],
                   check=True, stdout=subprocess.DEVNULL)
    with open("made.tmp.csv") as f, open(name, "w", newline="") as g:
        g.write("ms,vent_p_percent,vent_n_percent,p_bar,n_bar\n")
        # The first 4 s, in which the simulation comes to its own pressures, were not logged.
        for k, row in enumerate(list(csv.DictReader(f))[200:]):
            p, n = (float(row[c]) + random.gauss(0, 0.06) for c in ("p_pos_kpa", "p_neg_kpa"))
            u = [f"{100 * float(row[c]):.1f}" for c in ("u_pos", "u_neg")]
            g.write(f"{20 * k},{u[0]},{u[1]},{p / 100:.4f},{n / 100:.4f}\n")


logged("monday.csv", 49)
logged("tuesday.csv", 49)
