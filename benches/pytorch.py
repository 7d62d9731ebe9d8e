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


def convolution(name, function, x, weight, outputs, **settings):
    case(name, lambda x, w, b: function(x, w, b, **settings), leaf(*x), leaf(*weight), leaf(outputs))


convolution("conv2d 3x3 320->320 @32^2", F.conv2d, (1, 320, 32, 32), (320, 320, 3, 3), 320, padding=1)
convolution("conv2d 3x3 1280->1280 @8^2", F.conv2d, (1, 1280, 8, 8), (1280, 1280, 3, 3), 1280, padding=1)
convolution("conv2d 1x1 320->640 @32^2", F.conv2d, (1, 320, 32, 32), (640, 320, 1, 1), 640)
convolution("conv2d 3x3 depth-wise 256 @64^2", F.conv2d, (1, 256, 64, 64), (256, 1, 3, 3), 256, padding=1, groups=256)
convolution("conv3d 3^3 64->64 @32^3", F.conv3d, (1, 64, 32, 32, 32), (64, 64, 3, 3, 3), 64, padding=1)
convolution("conv_transpose3d 128->64 16^3->32^3", F.conv_transpose3d, (1, 128, 16, 16, 16), (128, 64, 3, 3, 3), 64,
            stride=2, padding=1, output_padding=1)

json.dump(rows, open(out, "w"), indent=1)
