"""Makes pointwise.safetensors with PyTorch 2.6 in double precision: python tests/vectors/pointwise.py

For each op: `<op>.x` (operands `.x`, `.b`, indices `.i`), result `.y`, weights `.w`, and `.g` (`.gb`), the gradients of sum(w y).
"""
import json, struct
from pathlib import Path
import torch
import torch.nn.functional as F

torch.manual_seed(3)
out = {}


def case(name, f, x, b=None, i=None):
    leaves = [t.clone().double().requires_grad_() for t in (x, b) if t is not None]
    y = f(*leaves, *([i] if i is not None else []))
    w = torch.rand_like(y) + 0.5
    (y * w).sum().backward()
    out[name + ".x"], out[name + ".y"], out[name + ".w"] = leaves[0], y, w
    out[name + ".g"] = leaves[0].grad
    if b is not None:
        out[name + ".b"], out[name + ".gb"] = leaves[1], leaves[1].grad
    if i is not None:
        out[name + ".i"] = i


x = torch.cat([torch.linspace(-6, 6, 41), torch.tensor([-30.0, 30.0, 0.25])])
for name, f in {
    "silu": F.silu, "gelu": F.gelu, "gelu_tanh": lambda x: F.gelu(x, approximate="tanh"),
    "gelu_sigmoid": lambda x: x * torch.sigmoid(1.702 * x), "erf": torch.erf, "elu": lambda x: F.elu(x, 0.7),
    "leaky_relu": lambda x: F.leaky_relu(x, 0.2), "clamp": lambda x: x.clamp(-1.25, 2.5), "sin": torch.sin,
    "cos": torch.cos, "pow_3": lambda x: x**3, "exp_m1": torch.expm1,
}.items():
    case(name, f, x)
p = torch.rand(12) * 3 + 0.1
for name, f in {"rsqrt": torch.rsqrt, "recip": torch.reciprocal, "ln_1p": torch.log1p, "pow_2.4": lambda x: x**2.4}.items():
    case(name, f, p)

r = torch.randn(3, 4, 5)
ties = torch.tensor([[1.0, 5.0, 5.0, 0.0], [2.0, -1.0, 2.0, -1.0]])
zeros = torch.tensor([[2.0, 0.0, -1.5, 3.0], [0.0, 0.0, 1.0, 4.0], [0.5, 2.0, -3.0, 1.0]])
case("logsumexp", lambda x: torch.logsumexp(300 * x, (0, 2)), r)
case("variance", lambda x: x.var((0, 2), correction=1), r)
case("max", lambda x: x.max(1).values, r)
case("min", lambda x: x.min(1).values, r)
case("max_ties", lambda x: x.max(1).values, ties)
case("prod", lambda x: x.prod(1), zeros)
case("cumsum", lambda x: x.cumsum(1), r)
case("cumprod", lambda x: x.cumprod(1), zeros)
i = torch.randint(0, 4, (2, 6, 5))
case("gather", lambda x, i: x.gather(1, i), r, i=i)
case("scatter_add", lambda x, b, i: x.scatter_add(1, i, b), r, torch.randn(2, 6, 5), i)
case("choose", lambda x, b: torch.where(x > 0, x, b), r, torch.randn(4, 1))


def sinusoid(t, size):
    half = size // 2
    f = torch.exp(-torch.log(torch.tensor(10000.0, dtype=torch.float64)) * torch.arange(half, dtype=torch.float64) / half)
    a = t[:, None] * f[None]
    y = torch.cat([a.cos(), a.sin()], -1)
    return torch.cat([y, torch.zeros_like(y[:, :1])], -1) if size % 2 else y


t = torch.tensor([0.0, 1.0, 21.0, 500.0, 981.0])
case("sinusoid_9", lambda t: sinusoid(t, 9), t)
case("sinusoid_8", lambda t: sinusoid(t, 8), t)

header, data = {}, b""
for name, value in out.items():
    value = value.detach()
    kind = "U32" if name.endswith(".i") else "F64"
    raw = (value.to(torch.int32) if kind == "U32" else value.double()).contiguous().numpy().tobytes()
    header[name] = {"dtype": kind, "shape": list(value.shape), "data_offsets": [len(data), len(data) + len(raw)]}
    data += raw
text = json.dumps(header).encode()
text += b" " * (-len(text) % 8)
Path(__file__).with_name("pointwise.safetensors").write_bytes(struct.pack("<Q", len(text)) + text + data)
