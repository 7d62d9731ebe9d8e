"""Writes normalisation_and_attention.safetensors with PyTorch in float64: python tests/vectors/attention.py

Every case holds its operands, the result `y`, the cotangent `g` of the result, and the gradients `grad.<operand>` of
sum(g y). The file format is written by hand so that PyTorch is all it needs.
"""
import json, pathlib, struct
import torch
import torch.nn.functional as F

torch.manual_seed(0)
torch.set_default_dtype(torch.float64)
tensors = {}


def case(name, function, **operands):
    leaves = {key: value.clone().requires_grad_() for key, value in operands.items()}
    y = function(**leaves)
    g = torch.randn_like(y)
    (y * g).sum().backward()
    for key, leaf in leaves.items():
        tensors[f"{name}.{key}"] = leaf.detach()
        tensors[f"{name}.grad.{key}"] = leaf.grad
    tensors[f"{name}.y"], tensors[f"{name}.g"] = y.detach(), g


r = torch.randn
case("group_norm", lambda x, scale, shift: F.group_norm(x, 3, scale, shift, 1e-5), x=r(2, 6, 3, 5), scale=r(6), shift=r(6))
case("group_norm_plain", lambda x: F.group_norm(x, 2, eps=1e-6), x=r(2, 4, 19))
case("group_norm_silu", lambda x, scale, shift: F.silu(F.group_norm(x, 2, scale, shift, 1e-5)), x=r(2, 4, 3, 4, 5), scale=r(4), shift=r(4))
case("group_norm_large_mean", lambda x, scale, shift: F.group_norm(x, 2, scale, shift, 1e-5), x=3000 + r(1, 4, 600), scale=r(4), shift=r(4))
case("layer_norm", lambda x, scale, shift: F.layer_norm(x, (37,), scale, shift, 1e-5), x=r(2, 5, 37), scale=r(37), shift=r(37))
case("layer_norm_two_axes", lambda x, scale, shift: F.layer_norm(x, (3, 7), scale, shift, 1e-5), x=r(4, 3, 7), scale=r(3, 7), shift=r(3, 7))
masked = 4 * r(3, 21, 5)
masked[1, 7, 2] = masked[0, :20, 3] = -torch.inf
for axis in range(3):
    case(f"softmax_{axis}", lambda x: F.softmax(x, axis), x=masked)
    case(f"log_softmax_{axis}", lambda x: F.log_softmax(x, axis), x=4 * r(3, 21, 5))


def attention(scale):
    def function(q, k, v, mask=None):
        return F.scaled_dot_product_attention(q, k, v, mask, scale=scale)

    return function


case("attention", attention(0.5), q=r(2, 2, 7, 5), k=r(2, 2, 9, 5), v=r(2, 2, 9, 6))
case("attention_blocks", attention(8**-0.5), q=2 * r(1, 130, 8), k=2 * r(1, 197, 8), v=r(1, 197, 7))
mask = r(2, 1, 7, 9)
mask[0, 0, 1, 3:] = mask[1, 0, :, 5] = -torch.inf
case("attention_masked", attention(0.5), q=r(2, 3, 7, 5), k=r(2, 3, 9, 5), v=r(2, 3, 9, 5), mask=mask)
case("attention_shared_mask", attention(0.5), q=r(2, 3, 7, 4), k=r(2, 3, 9, 4), v=r(2, 3, 9, 4), mask=r(7, 9))


def depth_attention(q, k, v):
    weights = (torch.einsum("nhcyx,nhcdyx->nhdyx", q, k) * 5**-0.5).softmax(2)
    return torch.einsum("nhdyx,nhcdyx->nhcyx", weights, v)


case("depth_attention", depth_attention, q=2 * r(2, 2, 5, 3, 7), k=2 * r(2, 2, 5, 6, 3, 7), v=r(2, 2, 5, 6, 3, 7))

header, data = {"__metadata__": {"made with": f"PyTorch {torch.__version__.split('+')[0]} in float64"}}, b""
for name, tensor in tensors.items():
    flat = tensor.contiguous().flatten().tolist()
    raw = struct.pack(f"<{len(flat)}d", *flat)
    header[name] = {"dtype": "F64", "shape": list(tensor.shape), "data_offsets": [len(data), len(data) + len(raw)]}
    data += raw
text = json.dumps(header).encode()
text += b" " * (-len(text) % 8)
out = pathlib.Path(__file__).with_name("normalisation_and_attention.safetensors")
out.write_bytes(struct.pack("<Q", len(text)) + text + data)
print(out, out.stat().st_size)
