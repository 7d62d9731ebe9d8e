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
    # the broadcast product: on the CPU 3 to 5 times faster than einsum, which is timed as well
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
mega, wide, image = 1 << 20, 16 << 20, (4, 320, 32, 32)
case("add 16M", torch.add, leaf(wide), leaf(wide))
case("mul 1M", torch.mul, leaf(mega), leaf(mega))
case("exp 1M", torch.exp, leaf(mega))
case("softplus 1M", F.softplus, leaf(mega))
case("gelu 1M", F.gelu, leaf(mega))
case("silu 1M", F.silu, leaf(mega))
case("bias add 65536x128", torch.add, leaf(65536, 128), leaf(128))
case("channel scale 4x320x32^2", torch.mul, leaf(*image), leaf(320, 1, 1))
case("sum all 16M", torch.sum, leaf(wide))
case("sum rows 4096x4096", lambda x: x.sum(1), leaf(4096, 4096))
case("sum columns 4096x4096", lambda x: x.sum(0), leaf(4096, 4096))
case("sum channels 4x320x32^2", lambda x: x.sum((0, 2, 3)), leaf(*image))
case("max rows 4096x4096", lambda x: x.max(1).values, leaf(4096, 4096))
case("cumsum 4096x1024", lambda x: x.cumsum(1), leaf(4096, 1024))
case("permute NCHW to NHWC 4x320x32^2", lambda x: x.permute(0, 2, 3, 1).contiguous(), leaf(*image))
case("permute heads 8x1024x8x40", lambda x: x.permute(0, 2, 1, 3).contiguous(), leaf(8, 1024, 8, 40))
case("concat channels 4x320x32^2", lambda a, b: torch.cat([a, b], 1), leaf(*image), leaf(*image))
case("pad 4x320x32^2", lambda x: F.pad(x, (1, 1, 1, 1)), leaf(*image))

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

def convolution(name, function, x, weight, outputs, **settings):
    case(name, lambda x, w, b: function(x, w, b, **settings), leaf(*x), leaf(*weight), leaf(outputs))


convolution("conv2d 3x3 320->320 @32^2", F.conv2d, (1, 320, 32, 32), (320, 320, 3, 3), 320, padding=1)
convolution("conv2d 3x3 1280->1280 @8^2", F.conv2d, (1, 1280, 8, 8), (1280, 1280, 3, 3), 1280, padding=1)
convolution("conv2d 1x1 320->640 @32^2", F.conv2d, (1, 320, 32, 32), (640, 320, 1, 1), 640)
convolution("conv2d 3x3 depth-wise 256 @64^2", F.conv2d, (1, 256, 64, 64), (256, 1, 3, 3), 256, padding=1, groups=256)
convolution("conv3d 3^3 64->64 @32^3", F.conv3d, (1, 64, 32, 32, 32), (64, 64, 3, 3, 3), 64, padding=1)
convolution("conv_transpose3d 128->64 16^3->32^3", F.conv_transpose3d, (1, 128, 16, 16, 16), (128, 64, 3, 3, 3), 64,
            stride=2, padding=1, output_padding=1)

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
