"""The depth network once more in NumPy, in double precision: features of two masked pictures and what the network says of them.

    python3 models/tests/vectors/depth/network.py

reads silhouettes.safetensors and models/weights/depth.safetensors, and writes layers.safetensors. Colours are a pattern of its own. Nothing of it is shared with the program: the half thickness is the definition, ball by ball.
"""

import json
import pathlib
import struct

import numpy as np

HERE = pathlib.Path(__file__).parent
SIZE = 64
TYPES = {"F16": np.float16, "F32": np.float32, "F64": np.float64, "U8": np.uint8}


def read(path):
    data = path.read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    head = json.loads(data[8 : 8 + length])
    about = head.pop("__metadata__", {})
    body = data[8 + length :]
    tensors = {}
    for name, entry in head.items():
        start, end = entry["data_offsets"]
        tensors[name] = np.frombuffer(body[start:end], TYPES[entry["dtype"]]).reshape(entry["shape"])
    return tensors, about


def write(path, tensors):
    head, body = {}, b""
    for name, x in tensors.items():
        kind = next(kind for kind, known in TYPES.items() if x.dtype == known)
        head[name] = {"dtype": kind, "shape": list(x.shape), "data_offsets": [len(body), len(body) + x.nbytes]}
        body += x.tobytes()
    text = json.dumps(head).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + body)


def features(colours, mask):
    """Planes of a picture `[3, 64, 64]` with a silhouette `[64, 64]`."""
    rows, columns = np.nonzero(mask)
    count = len(rows)
    diameter = 2 * np.sqrt(count / np.pi)
    inside = colours[:, rows, columns]
    normal = (inside - inside.mean()) / (inside.std() + 0.02)
    around = np.pad(mask, 1)
    outer = np.argwhere(~around) - 1
    balls = np.stack([rows, columns], 1)
    radii = np.array([((outer - ball) ** 2).sum(1).min() for ball in balls])
    half = np.array([(radii - ((balls - place) ** 2).sum(1)).max() for place in balls])
    planes = np.zeros((7, SIZE, SIZE))
    planes[:3, rows, columns] = normal
    planes[3, rows, columns] = 1
    planes[4, rows, columns] = np.sqrt(half) / diameter
    planes[5, rows, columns] = (columns - columns.mean()) / diameter
    planes[6, rows, columns] = (rows - rows.mean()) / diameter
    return planes


def conv(x, weight, bias=None, stride=1, padding=0):
    batch, _, height, width = x.shape
    outputs, _, size, _ = weight.shape
    x = np.pad(x, ((0, 0), (0, 0), (padding, padding), (padding, padding)))
    high, wide = (height + 2 * padding - size) // stride + 1, (width + 2 * padding - size) // stride + 1
    y = np.zeros((batch, outputs, high, wide))
    for i in range(size):
        for j in range(size):
            part = x[:, :, i : i + stride * high : stride, j : j + stride * wide : stride]
            y += np.einsum("oc,bchw->bohw", weight[:, :, i, j], part)
    return y if bias is None else y + bias[:, None, None]


def squares(x, weight, bias):
    """Every place becomes a square of 2x2."""
    batch, _, height, width = x.shape
    y = np.zeros((batch, weight.shape[1], 2 * height, 2 * width))
    for i in range(2):
        for j in range(2):
            y[:, :, i::2, j::2] = np.einsum("co,bchw->bohw", weight[:, :, i, j], x)
    return y + bias[:, None, None]


def group_norm(x, weight, bias):
    batch, channels, height, width = x.shape
    groups = x.reshape(batch, channels // 8, -1)
    groups = (groups - groups.mean(2, keepdims=True)) / np.sqrt(groups.var(2, keepdims=True) + 1e-5)
    return groups.reshape(x.shape) * weight[:, None, None] + bias[:, None, None]


def silu(x):
    return x / (1 + np.exp(-x))


class Network:
    def __init__(self, path):
        tensors, about = read(path)
        self.weights = {name: x.astype(np.float64) for name, x in tensors.items()}
        self.sizes = json.loads(about["gradreel.depth"])

    def layer(self, name):
        return self.weights[name + ".weight"], self.weights.get(name + ".bias")

    def block(self, x, name):
        h = conv(x, *self.layer(name + ".conv1"), padding=1)
        h = silu(group_norm(h, *self.layer(name + ".norm1")))
        h = conv(h, *self.layer(name + ".conv2"), padding=1)
        return x + group_norm(h, *self.layer(name + ".norm2"))

    def __call__(self, planes):
        batch = len(planes)
        x = planes * np.array([1, 1, 1, 1, 4, 2, 2.0])[:, None, None]
        x = np.stack([x[:, :, i::2, j::2] for i in range(2) for j in range(2)], 2).reshape(batch, 28, 32, 32)
        x = silu(conv(x, *self.layer("stem"), padding=1))
        skipped = []
        for level, blocks in enumerate(self.sizes["blocks"]):
            for block in range(blocks):
                x = self.block(x, f"encoder.{level}.{block}")
            if level < 3:
                skipped.append(x)
                x = silu(conv(x, *self.layer(f"down.{level}"), stride=2))
        for level in (2, 1, 0):
            x = self.block(silu(squares(x, *self.layer(f"up.{level}")) + skipped[level]), f"decoder.{level}")
        said = conv(x, *self.layer("head"), padding=1)
        maps = np.zeros((batch, 4, SIZE, SIZE))
        for i in range(2):
            for j in range(2):
                maps[:, :, i::2, j::2] = said[:, 2 * i + j : 16 : 4]
        mask, half = planes[:, 3], planes[:, 4]
        front, back = maps[:, 0] - half, maps[:, 1] + half
        weight = (np.maximum(back - front, 0) + 0.01) * mask
        middle = (weight * (front + back) / 2).sum((1, 2)) / (weight.sum((1, 2)) + 1e-6)
        shift = middle[:, None, None]
        return np.stack([front - shift, back - shift, maps[:, 2] - 2, maps[:, 3] - 2], 1)


def main():
    masks = read(HERE / "silhouettes.safetensors")[0]["silhouette"] > 0
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    colours = np.stack([0.5 + 0.4 * np.sin(7 * x + k) * np.cos(5 * y - k) for k in range(3)])
    colours = np.round(255 * colours) / 255
    planes = np.stack([features(colours, mask) for mask in masks])
    said = Network(HERE / "../../../weights/depth.safetensors")(planes)
    inside = masks[:, None]
    write(
        HERE / "layers.safetensors",
        {
            "colours": colours.astype(np.float32),
            "silhouette": masks.astype(np.uint8),
            "features": planes.astype(np.float32),
            "layers": (said * inside).astype(np.float32),
        },
    )


if __name__ == "__main__":
    main()
