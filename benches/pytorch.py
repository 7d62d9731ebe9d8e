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

for tokens, heads, channels in (1024, 8, 40), (256, 8, 80), (1024, 4, 64), (256, 8, 160):
    q, k, v = (leaf(1, heads, tokens, channels) for _ in range(3))
    case(f"attention {tokens}x{heads}x{channels}", F.scaled_dot_product_attention, q, k, v)


def depth_attention(q, k, v):
    # the broadcast product: on the CPU 2 to 3 times faster than einsum
    weights = ((q.unsqueeze(3) * k).sum(2) * q.shape[2] ** -0.5).softmax(2)
    return (weights.unsqueeze(2) * v).sum(3)


def depth_attention_einsum(q, k, v):
    weights = (torch.einsum("nhcyx,nhcdyx->nhdyx", q, k) * q.shape[2] ** -0.5).softmax(2)
    return torch.einsum("nhdyx,nhcdyx->nhcyx", weights, v)


for side, channels, depths in (32, 32, 48), (16, 64, 24), (8, 128, 12):
    q, k, v = leaf(1, 4, channels, side, side), *(leaf(1, 4, channels, depths, side, side) for _ in range(2))
    case(f"depth attention {side}^2 x {depths}", depth_attention, q, k, v)
    case(f"depth attention einsum {side}^2 x {depths}", depth_attention_einsum, q, k, v)

x, scale, shift = leaf(4, 320, 32, 32), leaf(320), leaf(320)
case("group norm 4x320x32^2", lambda *a: F.group_norm(a[0], 32, a[1], a[2]), x, scale, shift)
case("group norm + SiLU 4x320x32^2", lambda *a: F.silu(F.group_norm(a[0], 32, a[1], a[2])), x, scale, shift)
case("layer norm 4096x320", lambda *a: F.layer_norm(a[0], (320,), a[1], a[2]), leaf(4096, 320), scale, shift)
case("softmax 8192x1024", lambda x: F.softmax(x, 1), leaf(8192, 1024))
case("softmax columns 8x1024x1024", lambda x: F.softmax(x, 1), leaf(8, 1024, 1024))

json.dump(rows, open(out, "w"), indent=1)
