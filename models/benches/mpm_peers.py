"""One substep of the material point method and its reverse in other frameworks, on the CPU: nanoseconds per particle.

`python mpm_peers.py warp|taichi [threads] [particles]`. The scene of `mpm.rs`: a ball of radius (3 n / 4π)^(1/3) cm rests on
a sticky floor, grid spacing 2 cm, 8 particles per cell, f32, MLS-MPM with quadratic weights. Reverse is the adjoint kernels alone:
their states are kept, where gradreel computes them again. Process time is given for one thread, wall time for more.
"""

import math
import sys
import time

import numpy as np

peer = sys.argv[1]
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 1
count = int(sys.argv[3]) if len(sys.argv) > 3 else 20_000

DX, DT, DENSITY = 0.02, 2e-4, 1000.0
INVERSE = 1.0 / DX
VOLUME = (DX / 2) ** 3
MASS = DENSITY * VOLUME
YOUNG, POISSON, YIELD = 1e5, 0.3, 2e3
MU = YOUNG / (2 * (1 + POISSON))
LAMBDA = YOUNG * POISSON / ((1 + POISSON) * (1 - 2 * POISSON))
RADIUS = (3 * count * VOLUME / (4 * math.pi)) ** (1 / 3)
MARGIN = 4 * DX
NODES = int(math.ceil((2 * RADIUS + 2 * MARGIN) / DX)) + 1
FLOOR = 4
STEPS = 4


def ball():
    side = int(math.ceil(2 * RADIUS / (DX / 2))) + 1
    axis = (np.arange(side) - (side - 1) / 2) * DX / 2
    x = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    x = x[np.argsort((x**2).sum(1), kind="stable")[:count]]
    x = x[np.lexsort((np.floor(x[:, 2] / DX), np.floor(x[:, 1] / DX), np.floor(x[:, 0] / DX)))]
    return (x + RADIUS + MARGIN + 1e-4).astype(np.float32)


def report(material, forward, reverse, version):
    kind = "cpu" if threads == 1 else "wall"
    print(
        f"{peer} {version:<8} {material:<10} {count:>8} particles {threads:>2} threads   "
        f"forward {forward * 1e9:7.1f} ns   reverse {reverse * 1e9:7.1f} ns ({kind})",
        flush=True,
    )


def least(run, repeat=5):
    clock = time.process_time if threads == 1 else time.perf_counter
    run()
    best = math.inf
    for _ in range(repeat):
        begun = clock()
        run()
        best = min(best, clock() - begun)
    return best / (STEPS * count)


def with_warp():
    import warp as wp

    wp.config.quiet = True
    wp.config.verbose_warnings = False
    wp.init()

    @wp.func
    def weights(fx: wp.vec3):
        a = 1.5 - fx[0]
        b = 1.5 - fx[1]
        c = 1.5 - fx[2]
        d = fx[0] - 1.0
        e = fx[1] - 1.0
        f = fx[2] - 1.0
        g = fx[0] - 0.5
        h = fx[1] - 0.5
        i = fx[2] - 0.5
        return wp.mat33(
            0.5 * a * a, 0.5 * b * b, 0.5 * c * c,
            0.75 - d * d, 0.75 - e * e, 0.75 - f * f,
            0.5 * g * g, 0.5 * h * h, 0.5 * i * i,
        )  # fmt: skip

    @wp.func
    def elastic(F: wp.mat33):
        one = wp.identity(n=3, dtype=float)
        return MU * (F * wp.transpose(F) - one) + one * (LAMBDA * wp.log(wp.determinant(F)))

    @wp.func
    def plastic_strain(sigma: wp.vec3):
        e = wp.vec3(
            wp.log(wp.max(sigma[0], 0.05)), wp.log(wp.max(sigma[1], 0.05)), wp.log(wp.max(sigma[2], 0.05))
        )
        mean = (e[0] + e[1] + e[2]) / 3.0
        d = e - wp.vec3(mean, mean, mean)
        norm = 2.0 * MU * wp.sqrt(wp.dot(d, d) + 1.0e-12)
        keep = wp.min(1.0, wp.sqrt(2.0 / 3.0) * YIELD / norm)
        return d * keep + wp.vec3(mean, mean, mean)

    @wp.func
    def scatter(x: wp.vec3, v: wp.vec3, A: wp.mat33, gv: wp.array3d(dtype=wp.vec3), gm: wp.array3d(dtype=float)):
        at = x * INVERSE
        i = int(at[0] - 0.5)
        j = int(at[1] - 0.5)
        k = int(at[2] - 0.5)
        fx = at - wp.vec3(float(i), float(j), float(k))
        w = weights(fx)
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    d = (wp.vec3(float(a), float(b), float(c)) - fx) * DX
                    weight = w[a, 0] * w[b, 1] * w[c, 2]
                    wp.atomic_add(gv, i + a, j + b, k + c, (MASS * v + A * d) * weight)
                    wp.atomic_add(gm, i + a, j + b, k + c, weight * MASS)

    @wp.kernel
    def p2g_elastic(
        x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), C: wp.array(dtype=wp.mat33),
        F: wp.array(dtype=wp.mat33), F_new: wp.array(dtype=wp.mat33), gv: wp.array3d(dtype=wp.vec3), gm: wp.array3d(dtype=float),
    ):  # fmt: skip
        p = wp.tid()
        trial = F[p] + DT * (C[p] * F[p])
        F_new[p] = trial
        A = elastic(trial) * (-DT * VOLUME * 4.0 * INVERSE * INVERSE) + MASS * C[p]
        scatter(x[p], v[p], A, gv, gm)

    @wp.kernel
    def p2g_von_mises(
        x: wp.array(dtype=wp.vec3), v: wp.array(dtype=wp.vec3), C: wp.array(dtype=wp.mat33),
        F: wp.array(dtype=wp.mat33), F_new: wp.array(dtype=wp.mat33), gv: wp.array3d(dtype=wp.vec3), gm: wp.array3d(dtype=float),
    ):  # fmt: skip
        p = wp.tid()
        trial = F[p] + DT * (C[p] * F[p])
        U = wp.mat33()
        sigma = wp.vec3()
        V = wp.mat33()
        wp.svd3(trial, U, sigma, V)
        e = plastic_strain(sigma)
        F_new[p] = U * wp.diag(wp.vec3(wp.exp(e[0]), wp.exp(e[1]), wp.exp(e[2]))) * wp.transpose(V)
        trace = LAMBDA * (e[0] + e[1] + e[2])
        tau = U * wp.diag(2.0 * MU * e + wp.vec3(trace, trace, trace)) * wp.transpose(U)
        A = tau * (-DT * VOLUME * 4.0 * INVERSE * INVERSE) + MASS * C[p]
        scatter(x[p], v[p], A, gv, gm)

    @wp.kernel
    def grid(gv: wp.array3d(dtype=wp.vec3), gm: wp.array3d(dtype=float), out: wp.array3d(dtype=wp.vec3)):
        i, j, k = wp.tid()
        if gm[i, j, k] > 0.0:
            u = gv[i, j, k] / (gm[i, j, k] + 1.0e-10) + wp.vec3(0.0, -9.8 * DT, 0.0)
            if j < FLOOR:
                u = wp.vec3(0.0, 0.0, 0.0)
            out[i, j, k] = u

    @wp.kernel
    def g2p(
        x: wp.array(dtype=wp.vec3), out: wp.array3d(dtype=wp.vec3), x_new: wp.array(dtype=wp.vec3),
        v_new: wp.array(dtype=wp.vec3), C_new: wp.array(dtype=wp.mat33),
    ):  # fmt: skip
        p = wp.tid()
        at = x[p] * INVERSE
        i = int(at[0] - 0.5)
        j = int(at[1] - 0.5)
        k = int(at[2] - 0.5)
        fx = at - wp.vec3(float(i), float(j), float(k))
        w = weights(fx)
        nv = wp.vec3(0.0, 0.0, 0.0)
        nC = wp.mat33(0.0)
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    d = wp.vec3(float(a), float(b), float(c)) - fx
                    g = out[i + a, j + b, k + c] * (w[a, 0] * w[b, 1] * w[c, 2])
                    nv += g
                    nC += wp.outer(g, d) * (4.0 * INVERSE)
        x_new[p] = x[p] + DT * nv
        v_new[p] = nv
        C_new[p] = nC

    start = ball()
    shape = (NODES, NODES, NODES)
    new = lambda kind: wp.zeros(count, dtype=kind, device="cpu", requires_grad=True)
    for material, p2g in (("elastic", p2g_elastic), ("von Mises", p2g_von_mises)):
        X = [new(wp.vec3) for _ in range(STEPS + 1)]
        V = [new(wp.vec3) for _ in range(STEPS + 1)]
        C = [new(wp.mat33) for _ in range(STEPS + 1)]
        F = [new(wp.mat33) for _ in range(STEPS + 1)]
        X[0].assign(start)
        V[0].assign(np.tile(np.float32([0, -1, 0]), (count, 1)))
        F[0].assign(np.tile(np.identity(3, dtype=np.float32), (count, 1, 1)))
        grids = [
            (
                wp.zeros(shape, dtype=wp.vec3, device="cpu", requires_grad=True),
                wp.zeros(shape, dtype=float, device="cpu", requires_grad=True),
                wp.zeros(shape, dtype=wp.vec3, device="cpu", requires_grad=True),
            )
            for _ in range(STEPS)
        ]

        def forward():
            for s in range(STEPS):
                gv, gm, out = grids[s]
                gv.zero_(), gm.zero_(), out.zero_()
                wp.launch(p2g, count, inputs=[X[s], V[s], C[s], F[s], F[s + 1], gv, gm], device="cpu")
                wp.launch(grid, shape, inputs=[gv, gm, out], device="cpu")
                wp.launch(g2p, count, inputs=[X[s], out, X[s + 1], V[s + 1], C[s + 1]], device="cpu")

        def settled():
            for _ in range(10):
                forward()
                for A in (X, V, C, F):
                    A[0].assign(A[STEPS])

        settled()
        cost = least(forward)
        tape = wp.Tape()
        with tape:
            forward()
        ones = wp.array(np.full((count, 3), 1e-3, np.float32), dtype=wp.vec3, device="cpu")

        def reverse():
            tape.zero()
            tape.backward(grads={X[STEPS]: ones, V[STEPS]: ones})

        report(material, cost, least(reverse), wp.config.version)


def with_taichi():
    import taichi as ti

    ti.init(arch=ti.cpu, cpu_max_num_threads=threads, default_fp=ti.f32, log_level=ti.ERROR)

    def vector(*shape):
        return ti.Vector.field(3, ti.f32, shape=shape, needs_grad=True)

    def matrix(*shape):
        return ti.Matrix.field(3, 3, ti.f32, shape=shape, needs_grad=True)

    x, v, C, F = vector(2, count), vector(2, count), matrix(2, count), matrix(2, count)
    gv = vector(NODES, NODES, NODES)
    gm = ti.field(ti.f32, shape=(NODES, NODES, NODES), needs_grad=True)
    out = vector(NODES, NODES, NODES)

    @ti.func
    def corner(at):
        return ti.cast(at * INVERSE - 0.5, ti.i32)

    @ti.func
    def weights(fx):
        return [0.5 * (1.5 - fx) ** 2, 0.75 - (fx - 1.0) ** 2, 0.5 * (fx - 0.5) ** 2]

    @ti.kernel
    def clear():
        for I in ti.grouped(gm):
            gm[I] = 0.0
            gv[I] = ti.Vector.zero(ti.f32, 3)
            gm.grad[I] = 0.0
            gv.grad[I] = ti.Vector.zero(ti.f32, 3)
            out.grad[I] = ti.Vector.zero(ti.f32, 3)

    @ti.kernel
    def p2g():
        for p in range(count):
            trial = F[0, p] + DT * C[0, p] @ F[0, p]
            F[1, p] = trial
            one = ti.Matrix.identity(ti.f32, 3)
            tau = MU * (trial @ trial.transpose() - one) + one * (LAMBDA * ti.log(trial.determinant()))
            A = -(DT * VOLUME * 4.0 * INVERSE * INVERSE) * tau + MASS * C[0, p]
            base = corner(x[0, p])
            fx = x[0, p] * INVERSE - ti.cast(base, ti.f32)
            w = weights(fx)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                d = (ti.Vector([i, j, k]).cast(ti.f32) - fx) * DX
                weight = w[i][0] * w[j][1] * w[k][2]
                gv[base + ti.Vector([i, j, k])] += weight * (MASS * v[0, p] + A @ d)
                gm[base + ti.Vector([i, j, k])] += weight * MASS

    @ti.kernel
    def grid():
        for I in ti.grouped(gm):
            u = gv[I] / (gm[I] + 1e-10)
            u[1] -= DT * 9.8
            if I[1] < FLOOR:
                u = ti.Vector.zero(ti.f32, 3)
            out[I] = u

    @ti.kernel
    def g2p():
        for p in range(count):
            base = corner(x[0, p])
            fx = x[0, p] * INVERSE - ti.cast(base, ti.f32)
            w = weights(fx)
            nv = ti.Vector.zero(ti.f32, 3)
            nC = ti.Matrix.zero(ti.f32, 3, 3)
            for i, j, k in ti.static(ti.ndrange(3, 3, 3)):
                d = ti.Vector([i, j, k]).cast(ti.f32) - fx
                g = (w[i][0] * w[j][1] * w[k][2]) * out[base + ti.Vector([i, j, k])]
                nv += g
                nC += 4.0 * INVERSE * g.outer_product(d)
            v[1, p] = nv
            C[1, p] = nC
            x[1, p] = x[0, p] + DT * nv

    def repeated(array):
        return np.broadcast_to(array, (2,) + array.shape).astype(np.float32)

    x.from_numpy(repeated(ball()))
    v.from_numpy(repeated(np.tile(np.float32([0, -1, 0]), (count, 1))))
    C.from_numpy(repeated(np.zeros((count, 3, 3))))
    F.from_numpy(repeated(np.tile(np.identity(3), (count, 1, 1))))

    # the same substep several times: with its number as an argument, Taichi compiles for more than ten minutes
    def forward():
        for _ in range(STEPS):
            clear()
            p2g()
            grid()
            g2p()
        ti.sync()

    def reverse():
        for _ in range(STEPS):
            g2p.grad()
            grid.grad()
            p2g.grad()
        ti.sync()

    forward()
    cost = least(forward)
    for field in (x, v):
        field.grad.fill(1e-3)
    report("elastic", cost, least(reverse), ".".join(map(str, ti.__version__)))


with_warp() if peer == "warp" else with_taichi()
