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


def update(name, make, clip=None):
    """Times an optimiser's step on ten million numbers; there is no backward pass."""
    if wanted not in name:
        return
    x = leaf(10 << 20)
    x.grad = torch.rand(10 << 20) * 2 - 1
    optimiser = make([x])

    def step():
        if clip:
            torch.nn.utils.clip_grad_norm_([x], clip)
        optimiser.step()

    both = seconds(step) * 1e3
    rows[name] = {"forward": both, "both": both}
    print(f"{name:44} {both:10.3f} ms", flush=True)


update("AdamW update 10 Mi", lambda x: torch.optim.AdamW(x, lr=1e-4))
update("AdamW update 10 Mi, clipped", lambda x: torch.optim.AdamW(x, lr=1e-4), 1.0)
update("SGD momentum update 10 Mi", lambda x: torch.optim.SGD(x, lr=1e-4, momentum=0.9))

json.dump(rows, open(out, "w"), indent=1)
