"""scipy's least_squares on the points of a file: prints its processor time in ms and the answer (peers.cpp)."""
import sys
import time

import numpy as np
from scipy.optimize import least_squares

shape, file, has_outliers = sys.argv[1], sys.argv[2], sys.argv[3] == "1"
start = np.array([float(x) for x in sys.argv[4:]])
points = np.fromfile(file).reshape(-1, 3)


def sphere(s):
    return np.linalg.norm(points - s[:3], axis=1) - s[3]


def sphere_jacobian(s):
    u = points - s[:3]
    u /= np.linalg.norm(u, axis=1)[:, None]
    return np.column_stack([-u, -np.ones(len(u))])


def axis(s):
    a = np.array([s[2], 1.0, s[3]])
    return np.array([s[0], 0.0, s[1]]), a / np.linalg.norm(a)


def across(s):
    c, a = axis(s)
    u = points - c
    t = u @ a
    return u - t[:, None] * a, t


def cylinder(s):
    return np.linalg.norm(across(s)[0], axis=1) - s[4]


def cylinder_jacobian(s):
    v, t = across(s)
    n = v / np.linalg.norm(v, axis=1)[:, None]
    length = np.sqrt(1.0 + s[2] ** 2 + s[3] ** 2)
    return np.column_stack([-n[:, 0], -n[:, 2], -n[:, 0] * t / length, -n[:, 2] * t / length, -np.ones(len(n))])


loss = dict(loss="cauchy", f_scale=0.09) if has_outliers else dict(method="lm")
if shape == "sphere":
    x0, f, j = np.append(start[:3], start[6]), sphere, sphere_jacobian
else:
    a = start[3:6] / start[4]
    at = start[:3] - start[1] * a
    x0, f, j = np.array([at[0], at[2], a[0], a[2], start[6]]), cylinder, cylinder_jacobian
begin = time.process_time()
x = least_squares(f, x0, j, ftol=1e-12, **loss).x
ms = 1e3 * (time.process_time() - begin)
if shape == "sphere":
    print(ms, *x[:3], 0, 0, 1, x[3])
else:
    c, a = axis(x)
    print(ms, *c, *a, x[4])
