"""The networks of the multi-view model in PyTorch on the CPU: python models/benches/views_pytorch.py THREADS OUT.json [FILTER]

The same layers with the same shapes as `gradreel_models::views`, with random weights, written as one writes them in PyTorch.
Names are those of models/benches/views.rs. OMP_WAIT_POLICY=passive must be set: spinning threads make PyTorch several
times slower on small virtual machines, which would be no honest baseline.
"""
import json, math, os, sys, time

assert os.environ.get("OMP_WAIT_POLICY", "").lower() == "passive", "set OMP_WAIT_POLICY=passive"
import torch
import torch.nn.functional as F
from torch import nn

threads, out, wanted = int(sys.argv[1]), sys.argv[2], sys.argv[3] if len(sys.argv) > 3 else ""
torch.set_num_threads(threads)
torch.manual_seed(0)
torch.set_grad_enabled(False)


class Residual(nn.Module):
    def __init__(self, cin, cout, emb=None, eps=1e-5):
        super().__init__()
        self.a = nn.Sequential(nn.GroupNorm(32, cin, eps), nn.SiLU(), nn.Conv2d(cin, cout, 3, padding=1))
        self.emb = nn.Sequential(nn.SiLU(), nn.Linear(emb, cout)) if emb else None
        self.b = nn.Sequential(nn.GroupNorm(32, cout, eps), nn.SiLU(), nn.Conv2d(cout, cout, 3, padding=1))
        self.skip = nn.Conv2d(cin, cout, 1) if cin != cout else nn.Identity()

    def forward(self, x, t=None):
        h = self.a(x)
        if self.emb is not None:
            h = h + self.emb(t)[:, :, None, None]
        return self.skip(x) + self.b(h)


class Attention(nn.Module):
    def __init__(self, c, context, heads):
        super().__init__()
        self.q, self.k, self.v = (nn.Linear(n, c, bias=False) for n in (c, context, context))
        self.out, self.heads = nn.Linear(c, c), heads

    def forward(self, x, context):
        b, n, c = x.shape
        split = lambda y: y.view(b, -1, self.heads, c // self.heads).transpose(1, 2)
        y = F.scaled_dot_product_attention(split(self.q(x)), split(self.k(context)), split(self.v(context)))
        return self.out(y.transpose(1, 2).reshape(b, n, c))


class Transformer(nn.Module):
    def __init__(self, c, heads=8, context=768):
        super().__init__()
        self.norm, self.into, self.outof = nn.GroupNorm(32, c, 1e-6), nn.Conv2d(c, c, 1), nn.Conv2d(c, c, 1)
        self.n1, self.n2, self.n3 = nn.LayerNorm(c), nn.LayerNorm(c), nn.LayerNorm(c)
        self.own, self.cross = Attention(c, c, heads), Attention(c, context, heads)
        self.gate, self.ff = nn.Linear(c, 8 * c), nn.Linear(4 * c, c)

    def forward(self, x, context):
        b, c, h, w = x.shape
        y = self.into(self.norm(x)).flatten(2).transpose(1, 2)
        z = self.n1(y)
        y = y + self.own(z, z)
        y = y + self.cross(self.n2(y), context)
        value, gate = self.gate(self.n3(y)).chunk(2, -1)
        y = y + self.ff(value * F.gelu(gate))
        return x + self.outof(y.transpose(1, 2).reshape(b, c, h, w))


class DepthAttention(nn.Module):
    def __init__(self, c, d, context, heads=4):
        super().__init__()
        n = heads * d
        self.into = nn.Sequential(nn.Conv2d(c, n, 1), nn.GroupNorm(8, n), nn.SiLU())
        self.context = nn.Sequential(nn.Conv3d(context, context, 1, bias=False), nn.GroupNorm(8, context), nn.ReLU())
        self.q, self.o = nn.Conv2d(n, n, 1, bias=False), nn.Conv2d(n, n, 1, bias=False)
        self.k, self.v = nn.Conv3d(context, n, 1, bias=False), nn.Conv3d(context, n, 1, bias=False)
        self.outof = nn.Sequential(
            nn.GroupNorm(8, n), nn.ReLU(), nn.Conv2d(n, n, 3, padding=1, bias=False),
            nn.GroupNorm(8, n), nn.ReLU(), nn.Conv2d(n, c, 3, padding=1, bias=False))
        self.heads, self.d = heads, d

    def forward(self, x, volume):
        b, _, h, w = x.shape
        ctx = self.context(volume)
        q = self.q(self.into(x)).view(b, self.heads, self.d, 1, h, w)
        k, v = (f(ctx).view(b, self.heads, self.d, -1, h, w) for f in (self.k, self.v))
        weights = ((q * k).sum(2) * self.d**-0.5).softmax(2)
        found = (weights.unsqueeze(2) * v).sum(3).reshape(b, -1, h, w)
        return x + self.outof(self.o(found))


class Up(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.conv = nn.Conv2d(c, c, 3, padding=1)

    def forward(self, x):
        return self.conv(F.interpolate(x, scale_factor=2, mode="nearest"))


class Unet(nn.Module):
    def __init__(self):
        super().__init__()
        width, emb = [320, 640, 1280, 1280], 1280
        self.time = nn.Sequential(nn.Linear(320, emb), nn.SiLU(), nn.Linear(emb, emb))
        self.down, skips, c = nn.ModuleList([nn.ModuleList([nn.Conv2d(8, 320, 3, padding=1)])]), [320], 320
        for level in range(4):
            for _ in range(2):
                stage = [Residual(c, width[level], emb)]
                c = width[level]
                self.down.append(nn.ModuleList(stage + ([Transformer(c)] if level < 3 else [])))
                skips.append(c)
            if level < 3:
                self.down.append(nn.ModuleList([nn.Conv2d(c, c, 3, stride=2, padding=1)]))
                skips.append(c)
        self.middle = nn.ModuleList([Residual(c, c, emb), Transformer(c), Residual(c, c, emb)])
        volume = [64, 128, 256, 512]
        self.middle_depth = DepthAttention(c, 256, 512)
        self.up, self.depth = nn.ModuleList(), nn.ModuleList()
        for level in reversed(range(4)):
            for turn in range(3):
                stage = [Residual(c + skips.pop(), width[level], emb)]
                c = width[level]
                stage += [Transformer(c)] if level < 3 else []
                grows = turn == 2 and level > 0
                self.up.append(nn.ModuleList(stage + ([Up(c)] if grows else [])))
                at = level - grows
                if len(self.up) > 3:
                    self.depth.append(DepthAttention(c, volume[at] // 2, volume[at]))
        self.out = nn.Sequential(nn.GroupNorm(32, 320), nn.SiLU(), nn.Conv2d(320, 4, 3, padding=1))

    def forward(self, x, t, context, volumes):
        f = torch.exp(-math.log(10000) * torch.arange(160) / 160)
        time = self.time(torch.cat([torch.cos(t[:, None] * f), torch.sin(t[:, None] * f)], 1))

        def apply(stage, h):
            for layer in stage:
                if isinstance(layer, Residual):
                    h = layer(h, time)
                elif isinstance(layer, Transformer):
                    h = layer(h, context)
                else:
                    h = layer(h)
            return h

        skips = []
        for stage in self.down:
            x = apply(stage, x)
            skips.append(x)
        x = self.middle_depth(apply(self.middle, x), volumes[x.shape[-1]])
        for number, stage in enumerate(self.up):
            x = apply(stage, torch.cat([x, skips.pop()], 1))
            if number >= 3:
                x = self.depth[number - 3](x, volumes[x.shape[-1]])
        return self.out(x)


class Unit(nn.Module):
    def __init__(self, cin, cout, stride, view):
        super().__init__()
        self.t, self.v = nn.Conv3d(256, cin, 1), nn.Conv3d(4, cin, 1) if view else None
        self.norm = nn.GroupNorm(8, cin)
        self.conv = nn.ConvTranspose3d(cin, cout, 3, 2, 1, 1) if stride == 0 else nn.Conv3d(cin, cout, 3, stride, 1)

    def forward(self, x, t, v):
        x = x + self.t(t) + (self.v(v) if self.v is not None else 0)
        return self.conv(F.silu(self.norm(x)))


class VolumeNet(nn.Module):
    """The spatial net (three units a level, 256 input channels) or the frustum net (two, 64)."""

    def __init__(self, cin, units, view):
        super().__init__()
        w = [64, 128, 256, 512]
        self.into = nn.Conv3d(cin, 64, 3, padding=1)
        self.first = None if view else Unit(64, 64, 1, view)
        level = lambda i: nn.ModuleList([Unit(w[i], w[i + 1], 2, view)] + [Unit(w[i + 1], w[i + 1], 1, view) for _ in range(units - 1)])
        self.down = nn.ModuleList([level(i) for i in range(3)])
        self.up = nn.ModuleList([Unit(w[i + 1], w[i], 0, view) for i in (2, 1, 0)])

    def forward(self, x, t, v=None):
        x = self.into(x)
        levels = [self.first(x, t, v) if self.first is not None else x]
        for units in self.down:
            x = levels[-1]
            for unit in units:
                x = unit(x, t, v)
            levels.append(x)
        y = levels.pop()
        for unit in self.up:
            y = unit(y, t, v) + levels.pop()
        return y


class Middle(nn.Module):
    def __init__(self, c):
        super().__init__()
        self.a, self.b = Residual(c, c, eps=1e-6), Residual(c, c, eps=1e-6)
        self.norm = nn.GroupNorm(32, c, 1e-6)
        self.q, self.k, self.v, self.o = (nn.Conv2d(c, c, 1) for _ in range(4))

    def forward(self, x):
        x = self.a(x)
        h = self.norm(x)
        q, k, v = (f(h).flatten(2).transpose(1, 2) for f in (self.q, self.k, self.v))
        y = F.scaled_dot_product_attention(q, k, v).transpose(1, 2).reshape(x.shape)
        return self.b(x + self.o(y))


def decoder():
    c, layers = 512, [nn.Conv2d(4, 4, 1), nn.Conv2d(4, 512, 3, padding=1), Middle(512)]
    for level, width in ((3, 512), (2, 512), (1, 256), (0, 128)):
        for _ in range(3):
            layers.append(Residual(c, width, eps=1e-6))
            c = width
        layers += [Up(c)] if level else []
    return nn.Sequential(*layers, nn.GroupNorm(32, c, 1e-6), nn.SiLU(), nn.Conv2d(c, 3, 3, padding=1))


def encoder():
    c, layers = 128, [nn.Conv2d(3, 128, 3, padding=1)]
    for level, width in enumerate((128, 256, 512, 512)):
        for _ in range(2):
            layers.append(Residual(c, width, eps=1e-6))
            c = width
        layers += [nn.ZeroPad2d((0, 1, 0, 1)), nn.Conv2d(c, c, 3, 2)] if level < 3 else []
    return nn.Sequential(*layers, Middle(c), nn.GroupNorm(32, c, 1e-6), nn.SiLU(), nn.Conv2d(c, 8, 3, padding=1), nn.Conv2d(8, 8, 1))


class Clip(nn.Module):
    def __init__(self):
        super().__init__()
        self.patches = nn.Conv2d(3, 1024, 14, 14, bias=False)
        self.token, self.place = nn.Parameter(torch.randn(1, 1, 1024)), nn.Parameter(torch.randn(257, 1024))
        self.first, self.last = nn.LayerNorm(1024), nn.LayerNorm(1024)
        block = lambda: nn.ModuleList([nn.LayerNorm(1024), nn.Linear(1024, 3072), nn.Linear(1024, 1024), nn.LayerNorm(1024), nn.Linear(1024, 4096), nn.Linear(4096, 1024)])
        self.blocks = nn.ModuleList([block() for _ in range(24)])
        self.proj = nn.Linear(1024, 768, bias=False)

    def forward(self, x):
        x = self.patches(x).flatten(2).transpose(1, 2)
        x = self.first(torch.cat([self.token.expand(x.shape[0], -1, -1), x], 1) + self.place)
        b, n, _ = x.shape
        for norm, packed, o, second, wide, narrow in self.blocks:
            q, k, v = (y.reshape(b, n, 16, 64).transpose(1, 2) for y in packed(norm(x)).chunk(3, -1))
            x = x + o(F.scaled_dot_product_attention(q, k, v).transpose(1, 2).reshape(b, n, 1024))
            h = wide(second(x))
            x = x + narrow(h * torch.sigmoid(1.702 * h))
        return self.proj(self.last(x[:, 0]))


rows = json.load(open(out)) if os.path.exists(out) else {}


def case(name, make, *inputs):
    if wanted not in name:
        return
    net = make().eval()
    net(*inputs)
    best = 1e9
    for _ in range(4):
        begin = time.perf_counter()
        net(*inputs)
        best = min(best, time.perf_counter() - begin)
    rows[name] = {"forward": best * 1e3}
    print(f"{name:36} {best:8.3f} s", flush=True)
    json.dump(rows, open(out, "w"), indent=1)


def pyramid(batch):
    return {w: torch.randn(batch, c, w * 3 // 2, w, w) for w, c in ((32, 64), (16, 128), (8, 256), (4, 512))}


for batch, name in ((1, "unet"), (2, "unet with guidance"), (4, "unet of four views")):
    t, context = torch.full((batch,), 501.0), torch.randn(batch, 1, 768)
    case(name, Unet, torch.randn(batch, 8, 32, 32), t, context, pyramid(batch))
point = lambda c: torch.randn(1, c, 1, 1, 1)
case("spatial volume", lambda: VolumeNet(256, 3, False), torch.randn(1, 256, 32, 32, 32), point(256))
case("frustum pyramid", lambda: VolumeNet(64, 2, True), torch.randn(1, 64, 48, 32, 32), point(256), point(4))
case("decode", decoder, torch.randn(1, 4, 32, 32))
case("encode", encoder, torch.randn(1, 3, 256, 256))
case("clip", Clip, torch.randn(1, 3, 224, 224))
