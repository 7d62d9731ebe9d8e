"""Writes a checkpoint of the published model's names and sizes with PyTorch's own torch.save, 5.6 GB:

    python models/src/views/tests/write_checkpoint.py OUT.ckpt [SEED]

Names and shapes are those of models/tests/vectors/views/keys.tsv. The numbers are made from the names and a seed as the README
beside that list says, so that the vectors of the full size hold for them (seed nvs-full). Around the weights is what a training
leaves behind there. Needs 6 GB of memory.
"""
import collections, math, sys, time
from pathlib import Path
import numpy as np
import torch

out, seed = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "nvs-full"
PART = 1 << 20


def numbers(key, count):
    """FNV-1a of the text, then SplitMix64 counters to numbers in -1..1."""
    h = 0xCBF29CE484222325
    for byte in f"{seed}:{key}".encode():
        h = (h ^ byte) * 0x100000001B3 % 2**64
    values = np.empty(count, np.float32)
    for begin in range(0, count, PART):
        end = min(begin + PART, count)
        z = np.arange(begin + 1, end + 1, dtype=np.uint64)
        z *= np.uint64(0x9E3779B97F4A7C15)
        z += np.uint64(h)
        z ^= z >> np.uint64(30)
        z *= np.uint64(0xBF58476D1CE4E5B9)
        z ^= z >> np.uint64(27)
        z *= np.uint64(0x94D049BB133111EB)
        z ^= z >> np.uint64(31)
        z >>= np.uint64(40)
        values[begin:end] = z.astype(np.float32) * np.float32(2**-23) - np.float32(1)
    return values


def weight(key, shape):
    r = numbers(key, math.prod(shape))
    if len(shape) >= 2:
        r *= np.float32(math.sqrt(3 / math.prod(shape[1:])))
    else:
        r *= np.float32(0.1)
        if key.endswith("weight"):
            r += np.float32(1)
    return torch.from_numpy(r).reshape(shape)


begin = time.time()
rows = [line.split("\t") for line in (Path(__file__).parent / "../vectors/views/keys.tsv").read_text().splitlines()]
state = collections.OrderedDict()
for key, shape in rows:
    state[key] = weight(key, [] if shape == "scalar" else [int(n) for n in shape.split("x")])
made = time.time()
training = {"epoch": 3, "global_step": 80000, "pytorch-lightning_version": "1.9.0", "callbacks": {}, "lr_schedulers": []}
training["optimizer_states"] = [{"state": {0: {"step": torch.tensor(1.0), "exp_avg": torch.zeros(3)}}, "param_groups": []}]
torch.save({"state_dict": state, **training}, out)
count = sum(t.numel() for t in state.values())
print(f"{len(state)} tensors, {count} numbers, {Path(out).stat().st_size * 1e-9:.2f} GB: {made - begin:.0f} s to make, {time.time() - made:.0f} s to save")
