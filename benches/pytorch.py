"""The same cases in PyTorch on the CPU: python benches/pytorch.py THREADS OUT.json [FILTER]

Names are those of benches/core. OMP_WAIT_POLICY=passive must be set: spinning threads make PyTorch several times slower
on small virtual machines, which would be no honest baseline.
"""
import json, os, sys, time

assert os.environ.get("OMP_WAIT_POLICY", "").lower() == "passive", "set OMP_WAIT_POLICY=passive"
import torch
import torch.nn.functional as F

threads, out, wanted = int(sys.argv[1]), sys.argv[2], sys.argv[3] if len(sys.argv) > 3 else ""
torch.set_num_threads(threads)
torch.manual_seed(0)


def seconds(run):
    run()
    begin, best, runs = time.perf_counter(), 1e9, 0
    while runs < 4 or (time.perf_counter() - begin < 1.0 and runs < 200):
        start = time.perf_counter()
        run()
        best = min(best, time.perf_counter() - start)
        runs += 1
    return best


rows = json.load(open(out)) if os.path.exists(out) else {}


def case(name, function, *leaves):
    """Times function(*leaves) without and with the gradient of the sum of its result."""
    if wanted not in name:
        return

    def both():
        for leaf in leaves:
            leaf.grad = None
        function(*leaves).sum().backward()

    with torch.no_grad():
        forward = seconds(lambda: function(*leaves))
    rows[name] = {"forward": forward * 1e3, "both": seconds(both) * 1e3}
    print(f"{name:44} {rows[name]['forward']:10.3f} ms {rows[name]['both']:10.3f} ms", flush=True)


def leaf(*shape):
    return (torch.rand(*shape) * 2 - 1).requires_grad_()


case("gemm 1024^3", torch.matmul, leaf(1024, 1024), leaf(1024, 1024))
case("gemm 256x2304x1024", torch.matmul, leaf(256, 2304), leaf(2304, 1024))


def lookup(grid, at):
    return F.grid_sample(grid, at, align_corners=True)


def composite(alpha):
    left = torch.cumprod(torch.cat([torch.ones(len(alpha), 1), 1 - alpha], 1), 1)
    return (left[:, :-1] * alpha).sum() + left[:, -1].sum()


case("grid_sample_3d 64ch 32^3 -> 48x32x32", lookup, leaf(1, 64, 32, 32, 32), leaf(1, 48, 32, 32, 3))
case("grid_sample_2d 64ch 128^2 -> 256x256", lookup, leaf(1, 64, 128, 128), leaf(1, 256, 256, 2))
case("grid_sample_3d 1ch 128^3 -> 2^20 points", lookup, leaf(1, 1, 128, 128, 128), leaf(1, 1 << 20, 1, 1, 3))
case("composite 8192 rays x 128", composite, (torch.rand(8192, 128) * 0.1).requires_grad_())
destinations = torch.randint(1 << 16, (1 << 20,))
case("index_add 2^20 x 4 -> 2^16", lambda x: torch.zeros(1 << 16, 4).index_add(0, destinations, x), leaf(1 << 20, 4))
rays = torch.arange(1 << 20) >> 6
case("segment_sum 2^20 x 4 -> 2^14", lambda x: torch.zeros(1 << 14, 4).index_add(0, rays, x), leaf(1 << 20, 4))

json.dump(rows, open(out, "w"), indent=1)
