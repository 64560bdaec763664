#!/usr/bin/env python3
"""Reads GCVF, NRRD and NPY outputs with other people's code, and compares each with the PNG stack of the same print.

    pip install numpy pillow pynrrd
    for format in png gcvf nrrd npy; do pellucid coupon --format $format --out coupon-$format; done
    python benches/peers/read_containers.py coupon-png coupon-gcvf coupon-nrrd coupon-npy

GCVF by zipfile and xml.etree, NRRD by pynrrd, NPY by numpy.load, PNG by Pillow. Prints a line a folder and exits with 1
if one differs from the first in a label, the voxels' size, or which colour is which material.
"""

import argparse
import io
import json
import struct
import sys
import xml.etree.ElementTree
import zipfile
from pathlib import Path

import nrrd
import numpy as np
from PIL import Image


def labels_of(image, colors, background):
    """Labels [y][x], top row first, of an RGBA image; fails on any other colour."""
    assert image.mode == "RGBA", image.mode
    codes = np.asarray(image).astype(np.uint32) @ np.array([1, 1 << 8, 1 << 16, 1 << 24], np.uint32)
    labels = np.full(codes.shape, 255, np.uint8)
    for label, rgba in [(0, background), *colors.items()]:
        labels[codes == int.from_bytes(bytes(rgba), "little")] = label
    assert (labels != 255).all(), "a stray colour"
    return labels


def upright(layers, manifest):
    """The object's own layers with y growing, [z][y][x]."""
    volume = np.stack(layers)
    assert (volume[manifest["size"][2]:] == 0).all(), "material above the object"
    volume = volume[: manifest["size"][2]]
    return volume[:, ::-1] if manifest["row_order"] == "highest_y_first" else volume


def read_png(folder, manifest):
    colors = {m["label"]: m["rgba"] for m in manifest["materials"]}
    files = [folder / (manifest["files"] % layer) for layer in range(manifest["layers"])]
    layers = [labels_of(Image.open(file), colors, manifest["background"]) for file in files]
    return upright(layers, manifest), manifest["pitch_mm"], colors


def read_gcvf(folder, manifest):
    with zipfile.ZipFile(folder / manifest["files"]) as archive:
        assert archive.testzip() is None
        config = xml.etree.ElementTree.fromstring(archive.read("ConfigFile.xml"))
        number = lambda path: int(config.findtext(path))
        rgba = lambda text: tuple(int(v) for v in text.split())
        listed = config.findall("MaterialList/Material")
        labels = [m["label"] for m in manifest["materials"]]
        colors = {label: rgba(m.findtext("RGBA")) for label, m in zip(labels, listed, strict=True)}
        background = rgba(config.findtext("MaterialList/BackGroundMaterialRGBA"))
        start, prefix = number("SliceRange/StartIndex"), config.findtext("ImageFilePrefix")
        names = [f"{prefix}{start + i}.png" for i in range(number("SliceRange/NumberOfSlices"))]
        images = [Image.open(io.BytesIO(archive.read(name))) for name in names]
        size = (number("SliceDimensions/SliceWidth"), number("SliceDimensions/SliceHeight"))
        assert all(image.size == size for image in images)
        layers = [labels_of(image, colors, background) for image in images]
        for label, material in zip(labels, listed):
            found = sum(int((layer == label).sum()) for layer in layers)
            assert found == int(material.findtext("VoxelCount")), material.findtext("Name")
        check_display(archive, np.stack(layers))
    pitch = [25.4 / number("Resolution/XDpi"), 25.4 / number("Resolution/YDpi")]
    return upright(layers, manifest), [*pitch, number("Resolution/SliceThicknessNanoMeter") / 1e6], colors


def check_display(archive, layers):
    """Bounds, topmost layers and mesh fit the images, layers [z][row][column]."""
    solid = layers != 0
    where = np.argwhere(solid)
    low, high = where.min(0)[::-1], where.max(0)[::-1] + 1
    assert struct.unpack("<6f", archive.read("MeshBbx.ktn")) == (*low, *high)
    top = np.where(solid.any(0), len(layers) - 1 - solid[::-1].argmax(0), 0)
    zbuffer = np.asarray(Image.open(io.BytesIO(archive.read("Zbuffer.png"))))
    assert (zbuffer == top).all()
    stl = archive.read("Mesh.stl")
    assert len(stl) == 84 + 50 * struct.unpack_from("<I", stl, 80)[0]


def read_nrrd(folder, manifest):
    data, header = nrrd.read(str(folder / manifest["files"]), index_order="C")
    assert data.dtype == np.uint8
    directions = np.asarray(header["space directions"])
    assert (directions == np.diag(np.diag(directions))).all() and header["space units"] == ["mm"] * 3
    pitch = list(np.diag(directions))
    corner = np.asarray(header["space origin"]) - np.array(pitch) / 2
    assert np.allclose(corner, manifest["origin_mm"], atol=1e-12)
    colors = {}
    for m in manifest["materials"]:
        assert header[f"material {m['label']}"] == m["name"]
        colors[m["label"]] = [int(v) for v in header[f"rgba {m['label']}"].split()]
    return data, pitch, colors


def read_npy(folder, manifest):
    colors = {m["label"]: m["rgba"] for m in manifest["materials"]}
    return np.load(folder / manifest["files"]), manifest["pitch_mm"], colors


def read(folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    readers = {".png": read_png, ".gcvf": read_gcvf, ".nrrd": read_nrrd, ".npy": read_npy}
    labels, pitch, colors = readers[Path(manifest["files"]).suffix](folder, manifest)
    assert labels.shape == tuple(manifest["size"][::-1]), labels.shape
    return manifest, labels, pitch, {label: tuple(rgba) for label, rgba in colors.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("png", type=Path, help="output folder with a PNG stack")
    parser.add_argument("others", type=Path, nargs="+", help="outputs of the same print in other containers")
    arguments = parser.parse_args()
    _, labels, pitch, colors = read(arguments.png)
    wrong = False
    for folder in arguments.others:
        manifest, other, other_pitch, other_colors = read(folder)
        same = np.array_equal(labels, other) and np.allclose(pitch, other_pitch, rtol=1e-15, atol=0)
        same = same and colors == other_colors
        wrong |= not same
        solid = int((other != 0).sum())
        print(f"{folder}: {manifest['files']}, {other.shape} voxels, {solid} solid: {'same' if same else 'DIFFERS'}")
    sys.exit(wrong)


if __name__ == "__main__":
    main()
