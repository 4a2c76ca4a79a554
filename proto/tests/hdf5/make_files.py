"""Writes the HDF5 files that `recording_hdf5` reads, by libhdf5: `python3 make_files.py` (h5py, NumPy).

`run_v73.mat` is laid out as MATLAB 7.3 lays out its own (`save('run_v73.mat', '-v7.3')`): a user block of 512 bytes, a class
beside each array, matrices column by column. `run.h5` is what a logger in Python writes: records, and channels by samples.
"""

import h5py
import numpy as np

ROWS = 60
k = np.arange(ROWS, dtype=float)
time_s = 0.02 * k


def wave(speed):
    return np.round(np.sin(speed * k), 4)


# The numbers of `logged::row`.
u = np.stack([0.7 + 0.1 * wave(0.3), 0.8 + 0.1 * wave(0.2)])
p_kpa = np.stack([90.0 + wave(0.7), -66.0 + wave(0.9)])


def matlab_array(group, name, rows_by_columns, matlab_class="double", **how):
    data = group.create_dataset(name, data=np.asarray(rows_by_columns).T, **how)
    data.attrs["MATLAB_class"] = np.bytes_(matlab_class)
    return data


with h5py.File("run_v73.mat", "w", userblock_size=512, libver="earliest") as file:
    packed = {"chunks": True, "compression": "gzip", "compression_opts": 3}
    matlab_array(file, "time_s", time_s[:, None], **packed)
    matlab_array(file, "u", u.T.astype(np.float32), "single", **packed)
    run = file.create_group("run")
    run.attrs["MATLAB_class"] = np.bytes_("struct")
    matlab_array(run, "p_pos_kpa", p_kpa[0][None, :])
    matlab_array(run, "p_neg_kpa", p_kpa[1][:, None])
    on = matlab_array(file, "on", (k > 5)[:, None].astype(np.uint8), "logical")
    on.attrs["MATLAB_int_decode"] = np.int32(1)
    matlab_array(file, "gain", [[3.0]])
    note = matlab_array(file, "note", [[ord(letter) for letter in "a run of sixty rows, and a note that is longer than it"]], "char")
    note.attrs["MATLAB_int_decode"] = np.int32(2)
    nothing = file.create_dataset("nothing", data=np.array([0, 0], dtype=np.uint64))
    nothing.attrs["MATLAB_class"] = np.bytes_("double")
    nothing.attrs["MATLAB_empty"] = np.uint8(1)
    kept = matlab_array(file.create_group("#refs#"), "a", k[:, None])
    cell = file.create_dataset("cell", data=np.array([[kept.ref]], dtype=h5py.ref_dtype))
    cell.attrs["MATLAB_class"] = np.bytes_("cell")
    table = file.create_dataset("tt", data=np.arange(6, dtype=np.uint32)[None, :])
    table.attrs["MATLAB_class"] = np.bytes_("timetable")
    table.attrs["MATLAB_object_decode"] = np.int32(3)
with open("run_v73.mat", "r+b") as file:
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Nov 30 12:00:00 2026 HDF5 schema 1.00 ."
    file.write(head.ljust(116) + bytes(8) + b"\x00\x02IM")

with h5py.File("run.h5", "w", libver=("v110", "v110")) as file:
    record = np.zeros(ROWS, dtype=[("u_pos", "<f4"), ("u_neg", ">f8"), ("tick", "<u4"), ("on", "?"), ("note", "S3")])
    record["u_pos"], record["u_neg"], record["tick"], record["on"] = u[0], u[1], k, k > 5
    file["log/record"] = record
    time = file.create_dataset("log/time", data=np.round(1000 * time_s).astype(np.int32))
    time.attrs["units"] = "ms"
    p = file.create_dataset("log/p", data=p_kpa.astype(">f8"), chunks=(1, 16), shuffle=True, compression="gzip")
    p.attrs["units"] = "kPa"
    file["log/setpoints"] = np.arange(5.0)
    file["log/half"] = k.astype(np.float16)
    # As a small file may claim to hold: nothing of it is stored.
    file.create_dataset("log/huge", shape=(2**40,), chunks=(2**20,), dtype=np.uint8, compression="gzip")
    file["1/2/3/4/5/6/7/deep"] = k
    file["log/spectrum"] = np.zeros(ROWS, dtype=complex)
