#!/usr/bin/env python3
"""The network in PyTorch, from our weight files: agrees with our own kernels to 1e-5.

    pip install torch
    cargo run --release -p pellucid-rpnn --features weights --example peer_samples -- FOLDER [WEIGHTS]
    python benches/peers/rpnn_torch.py FOLDER

FOLDER then holds weights.safetensors, the file that the library carries or WEIGHTS, any other file
of `pellucid train`, and samples.safetensors:
raw stencils of a halftoned ball, the points' first flights, and the outputs and radiance of our
f32 kernels for them. Prints one JSON object with the number of parameters and the worst
differences; exits with 1 if one is above 1e-5.

`Rpnn` and `load` are all it takes to use our weights elsewhere.
"""

import json
import pathlib
import struct
import sys

import torch
from torch import nn

LEVELS, CELLS = 9, (9, 3, 5)  # cells z, y, x; each has sigma_s and sigma_a
LEVEL_INPUTS, OCTANTS, OCTANT_INPUTS = 270, 8, 60
TOLERANCE = 1e-5


def load(path):
    """The f32 tensors and the header of a safetensors file."""
    data = pathlib.Path(path).read_bytes()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    about = json.loads(header.pop("__metadata__", {}).get("pellucid", "{}"))
    tensors = {}
    for name, entry in header.items():
        if entry["dtype"] != "F32":
            raise ValueError(f"{name} is {entry['dtype']}, not F32")
        first, end = (8 + length + at for at in entry["data_offsets"])
        values = torch.frombuffer(bytearray(data[first:end]), dtype=torch.float32)
        tensors[name] = values.reshape(entry["shape"])
    return tensors, about


def octant_positions():
    """Where an octant's 60 inputs lie among a level's 270, outward from the centre."""
    middle = [n // 2 for n in CELLS]
    positions = []
    for octant in range(OCTANTS):
        side = [1 - 2 * (octant >> axis & 1) for axis in (2, 1, 0)]  # bit 0 mirrors x
        for z in range(5):
            for y in range(2):
                for x in range(3):
                    at = [m + s * o for m, s, o in zip(middle, side, (z, y, x))]
                    cell = (at[0] * CELLS[1] + at[1]) * CELLS[2] + at[2]
                    positions += [2 * cell, 2 * cell + 1]
    return torch.tensor(positions)


class Rpnn(nn.Module):
    """The four variants by the names of a file's tensors: `baseline`, `L`, `O`, `L+O`.

    Reads raw stencils `[samples][9][270]`, 1/mm, finest level first. Gives radiance `[samples]`, or
    with a first-flight head the outputs `[samples][4]`, from which `radiance` makes radiance.
    """

    def __init__(self, tensors, about):
        super().__init__()
        form = about["provenance"]
        self.shared_levels = "L" in about["variant"]
        self.octants = "O" in about["variant"]
        self.logarithms = form["transform"] == "log"
        self.coarse_first = form.get("order", "fine-to-coarse") == "coarse-to-fine"
        self.flies_first = about.get("head", "radiance") == "first-flight"
        self.layers = nn.ParameterDict({n.replace(".", "/"): nn.Parameter(t) for n, t in tensors.items()})
        self.register_buffer("positions", octant_positions())

    def dense(self, name, values):
        key = name.replace(".", "/")
        bias = f"{key}/bias"
        return nn.functional.linear(
            values, self.layers[f"{key}/weight"], self.layers[bias] if bias in self.layers else None
        )

    def has(self, name):
        return f"{name.replace('.', '/')}/weight" in self.layers

    def inputs(self, stencils):
        scale = 2.0 ** torch.arange(LEVELS).reshape(1, LEVELS, 1, 1)
        cells = stencils.reshape(-1, LEVELS, LEVEL_INPUTS // 2, 2) * scale
        if self.logarithms:
            cells = torch.log1p(cells * torch.tensor([0.2, 30.0])) / torch.tensor([3.0, 4.0])
        else:
            cells = cells / 64.0
        levels = cells.reshape(-1, LEVELS, LEVEL_INPUTS)
        return levels.flip(1) if self.coarse_first else levels

    def forward(self, stencils):
        levels = self.inputs(stencils)
        samples = len(levels)
        width = OCTANTS * OCTANT_INPUTS if self.octants else LEVEL_INPUTS
        state = torch.zeros(samples, width)
        for k in range(LEVELS):
            block = "level" if self.shared_levels else f"level{k + 1}"
            value = levels[:, k]
            if self.octants:
                value = value[:, self.positions].reshape(samples, OCTANTS, OCTANT_INPUTS)
            for pair in (("octant1", "octant2"), ("dense1", "dense2")):
                for layer in pair:
                    if self.has(f"{block}.{layer}"):
                        value = torch.relu(self.dense(f"{block}.{layer}", value))
            value = value.reshape(samples, width)
            if not self.has(f"{block}.b"):
                state = value
                continue
            if self.has(f"{block}.a"):
                value = self.dense(f"{block}.a", value)
            mixed = torch.relu(value + self.dense(f"{block}.b", state))
            state = torch.relu(self.dense(f"{block}.c", mixed) + state)
        rows = state.reshape(samples, -1, OCTANT_INPUTS if self.octants else LEVEL_INPUTS)
        hidden = torch.relu(self.dense("end2", torch.relu(self.dense("end1", rows))))
        outputs = self.dense("end3", hidden).sum(1)
        return outputs if self.flies_first else torch.relu(outputs).squeeze(1)


def radiance(outputs, flights):
    """Radiance from a network's outputs and the samples' exact first flights `[samples][5]`."""
    if outputs.dim() == 1:
        return outputs
    masses, escaped, returned = flights[:, :3], flights[:, 3], flights[:, 4]
    scattered = (masses * outputs[:, :3]).sum(1)
    return torch.relu(scattered + escaped + returned * outputs[:, 3])


def main():
    folder = pathlib.Path(sys.argv[1])
    tensors, about = load(folder / "weights.safetensors")
    samples, _ = load(folder / "samples.safetensors")
    network = Rpnn(tensors, about)
    with torch.no_grad():
        outputs = network(samples["stencils"])
        of_radiance = radiance(outputs, samples["flights"])
    worst = {
        "outputs": (outputs.reshape(len(of_radiance), -1) - samples["outputs"]).abs().max().item(),
        "radiance": (of_radiance - samples["radiance"]).abs().max().item(),
    }
    told = {
        "variant": about["variant"],
        "head": about.get("head", "radiance"),
        "parameters": sum(p.numel() for p in network.parameters()),
        "samples": len(of_radiance),
        "mean_radiance": of_radiance.mean().item(),
        "worst": worst,
        "torch": torch.__version__,
    }
    print(json.dumps(told, indent=2))
    sys.exit(any(difference > TOLERANCE for difference in worst.values()))


if __name__ == "__main__":
    main()
