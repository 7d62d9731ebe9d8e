"""Writes convolution.safetensors with PyTorch in float64: python tests/vectors/convolution.py

Every case holds its operands, the result `y`, the cotangent `g` of the result, and the gradients `grad.<operand>` of
sum(g y). Those of convolutions also hold `second.<operand>`: the gradients of the sum of the squares of `grad.x` and
`grad.w`. The file format is written by hand so that PyTorch is all it needs.
"""
import json, pathlib, struct
import torch
import torch.nn.functional as F

torch.manual_seed(0)
torch.set_default_dtype(torch.float64)
tensors = {}


def case(name, function, second=False, **operands):
    leaves = {key: value.clone().requires_grad_() for key, value in operands.items()}
    y = function(**leaves)
    g = torch.randn_like(y)
    slopes = dict(zip(leaves, torch.autograd.grad((y * g).sum(), list(leaves.values()), create_graph=second)))
    for key, leaf in leaves.items():
        tensors[f"{name}.{key}"] = leaf.detach()
        tensors[f"{name}.grad.{key}"] = slopes[key].detach()
    tensors[f"{name}.y"], tensors[f"{name}.g"] = y.detach(), g
    if second:
        squares = slopes["x"].square().sum() + slopes["w"].square().sum()
        for key, slope in zip("xw", torch.autograd.grad(squares, [leaves["x"], leaves["w"]])):
            tensors[f"{name}.second.{key}"] = slope


def conv(name, function, x, w, bias=None, **settings):
    operands = {"x": torch.randn(*x), "w": torch.randn(*w)} | ({"b": torch.randn(bias)} if bias else {})
    case(name, lambda x, w, b=None: function(x, w, b, **settings), second=True, **operands)


conv("conv1d", F.conv1d, (2, 3, 11), (5, 3, 4), 5, stride=2, padding=1)
conv("conv2d", F.conv2d, (2, 3, 7, 6), (6, 3, 3, 3), 6, padding=1)
conv("conv2d_dilated", F.conv2d, (1, 2, 9, 10), (5, 2, 3, 2), None, stride=(2, 1), padding=(3, 1), dilation=(2, 3))
conv("conv2d_groups", F.conv2d, (2, 6, 5, 6), (12, 3, 3, 3), 12, stride=2, padding=1, groups=2)
conv("conv2d_depthwise", F.conv2d, (1, 5, 6, 9), (5, 1, 3, 3), 5, padding=1, groups=5)
conv("conv2d_point", F.conv2d, (2, 6, 4, 5), (7, 6, 1, 1), 7)
conv("conv2d_wide", F.conv2d, (1, 17, 13, 15), (18, 17, 3, 3), 18, padding=1)
conv("conv3d", F.conv3d, (1, 3, 4, 5, 6), (5, 3, 3, 2, 3), 5, stride=(1, 2, 1), padding=(1, 0, 1))
conv("transposed1d", F.conv_transpose1d, (2, 5, 6), (5, 6, 3), 6, stride=3, padding=1, output_padding=2)
conv("transposed2d", F.conv_transpose2d, (1, 6, 4, 5), (6, 5, 3, 4), None, stride=2, padding=(1, 2), output_padding=1)
conv("transposed2d_dilated", F.conv_transpose2d, (1, 5, 4, 3), (5, 5, 2, 3), 5, stride=(2, 1), output_padding=(2, 1), dilation=(3, 2))
conv("transposed2d_groups", F.conv_transpose2d, (2, 4, 3, 4), (4, 5, 3, 3), 10, stride=2, padding=1, groups=2)
conv("transposed3d", F.conv_transpose3d, (1, 5, 3, 2, 3), (5, 6, 3, 3, 3), 6, stride=2, padding=1, output_padding=1)

r = torch.randn
case("max_pool1d", lambda x: F.max_pool1d(x, 3, 2, 1), x=r(2, 2, 8))
case("max_pool2d", lambda x: F.max_pool2d(x, (2, 3), (2, 1), (1, 1)), x=r(2, 2, 5, 6))
case("max_pool3d", lambda x: F.max_pool3d(x, 2), x=r(1, 2, 4, 5, 4))
case("average_pool1d", lambda x: F.avg_pool1d(x, 3, 2, 1), x=r(2, 2, 8))
case("average_pool2d", lambda x: F.avg_pool2d(x, (2, 3), (2, 1), (1, 1)), x=r(2, 2, 5, 6))
case("average_pool2d_pixels", lambda x: F.avg_pool2d(x, 3, 2, 1, count_include_pad=False), x=r(1, 2, 5, 6))
case("average_pool3d", lambda x: F.avg_pool3d(x, 2), x=r(1, 2, 4, 5, 4))

case("nearest", lambda x: F.interpolate(x, size=(7, 4), mode="nearest"), x=r(1, 2, 5, 6))
case("nearest_doubled", lambda x: F.interpolate(x, scale_factor=2, mode="nearest"), x=r(1, 2, 2, 3, 2))
case("nearest_scaled", lambda x: F.interpolate(x, scale_factor=1.7, mode="nearest"), x=r(1, 2, 9))
case("linear", lambda x: F.interpolate(x, size=9, mode="linear"), x=r(1, 2, 5))
case("bilinear", lambda x: F.interpolate(x, size=(3, 9), mode="bilinear"), x=r(1, 2, 5, 4))
case("bilinear_corners", lambda x: F.interpolate(x, size=(3, 9), mode="bilinear", align_corners=True), x=r(1, 2, 5, 4))
case("bilinear_scaled", lambda x: F.interpolate(x, scale_factor=1.6, mode="bilinear"), x=r(1, 2, 5, 4))
case("trilinear", lambda x: F.interpolate(x, scale_factor=2, mode="trilinear"), x=r(1, 2, 2, 3, 4))
case("trilinear_corners", lambda x: F.interpolate(x, size=(1, 5, 4), mode="trilinear", align_corners=True), x=r(1, 2, 2, 3, 4))

header, data = {"__metadata__": {"made with": f"PyTorch {torch.__version__.split('+')[0]} in float64"}}, b""
for name, tensor in tensors.items():
    flat = tensor.contiguous().flatten().tolist()
    raw = struct.pack(f"<{len(flat)}d", *flat)
    header[name] = {"dtype": "F64", "shape": list(tensor.shape), "data_offsets": [len(data), len(data) + len(raw)]}
    data += raw
text = json.dumps(header).encode()
text += b" " * (-len(text) % 8)
out = pathlib.Path(__file__).with_name("convolution.safetensors")
out.write_bytes(struct.pack("<Q", len(text)) + text + data)
print(out, out.stat().st_size)
