#!/usr/bin/env python3
"""Mitsuba 3's time for paths from the surface of a halftoned print, index-matched, one thread.

    pip install mitsuba
    python benches/peers/mitsuba_prints.py FOLDER [--variant scalar_rgb|llvm_ad_mono] [--paths N]

FOLDER has `labels.u8`, a label a voxel, x fastest, and `scene.json`, as the study `error_vs_time` writes them: `size` (voxels
along x, y, z), `pitch_mm`, `g`, `sigma_t` (1/mm) and `albedo` by channel and label (0 is air), and `points` with a
`position_mm` on the surface and the `direction` in which paths go inward.

Prints one JSON object: processor seconds a path, the mean radiance of all points by channel, and its standard error. Paths
that leave a part and enter another go on there. Russian roulette is off: its cap below the albedo would give weights of
infinite variance.
"""

import argparse
import json
import pathlib
import time

import mitsuba as mi
import numpy as np


def scene(labels, given, channel):
    edge = [n * p for n, p in zip(given["size"], given["pitch_mm"])]
    box = mi.ScalarTransform4f().scale(edge)

    def grid(by_label):
        values = np.asarray(by_label, dtype=np.float32)[labels][..., None]
        return {
            "type": "gridvolume",
            "grid": mi.VolumeGrid(values),
            "filter_type": "nearest",
            "to_world": box,
            "raw": True,
        }

    medium = {
        "type": "heterogeneous",
        "albedo": grid(given["albedo"][channel]),
        "sigma_t": grid(given["sigma_t"][channel]),
        "phase": {"type": "hg", "g": given["g"]},
        "sample_emitters": False,
    }
    # A cube reaches from -1 to 1.
    cube = mi.ScalarTransform4f().scale([e / 2 for e in edge]).translate([1.0, 1.0, 1.0])
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "volpath", "max_depth": -1, "rr_depth": 1_000_000},
            "print": {"type": "cube", "to_world": cube, "bsdf": {"type": "null"}, "interior": medium},
            "light": {"type": "constant", "radiance": {"type": "uniform", "value": 1.0}},
        }
    )


def rays(given):
    points = given["points"]
    return [np.array([p[key] for p in points]) for key in ("position_mm", "direction")]


def scalar(loaded, given, paths, seed):
    """Radiances, `[point][path]`, and processor seconds."""
    integrator, medium = loaded.integrator(), loaded.shapes()[0].interior_medium()
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed)
    positions, directions = rays(given)
    found = np.zeros((len(positions), paths))
    start = time.process_time()
    for i, (o, d) in enumerate(zip(positions, directions)):
        ray = mi.RayDifferential3f(mi.Ray3f(o.tolist(), d.tolist()))
        for k in range(paths):
            found[i, k] = integrator.sample(loaded, sampler, ray, medium)[0][0]
    return found, time.process_time() - start


def wavefront(loaded, given, paths, seed):
    """The same, all at once."""
    import drjit as dr

    integrator, medium = loaded.integrator(), loaded.shapes()[0].interior_medium()
    positions, directions = (np.repeat(a, paths, axis=0).T.astype(np.float32) for a in rays(given))

    def run(count, seed):
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(seed, count)
        ray = mi.RayDifferential3f(mi.Ray3f(mi.Point3f(positions[:, :count]), mi.Vector3f(directions[:, :count])))
        value = integrator.sample(loaded, sampler, ray, medium)[0]
        dr.eval(value)
        dr.sync_thread()
        return np.array(value)

    # Its program is compiled by the first run.
    run(64, seed + 1)
    start = time.process_time()
    found = run(positions.shape[1], seed)
    return found.reshape(-1, paths), time.process_time() - start


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--variant", default="scalar_rgb")
    parser.add_argument("--paths", type=int, default=128)
    args = parser.parse_args()
    mi.set_variant(args.variant)
    try:
        import drjit as dr

        dr.set_thread_count(1)
    except (ImportError, AttributeError):
        pass
    given = json.loads((args.folder / "scene.json").read_text())
    labels = np.fromfile(args.folder / "labels.u8", dtype=np.uint8).reshape(given["size"][::-1])
    measure = scalar if args.variant.startswith("scalar") else wavefront
    result = {"mitsuba": mi.__version__, "variant": args.variant, "seconds": 0.0, "radiance": [], "std_error": []}
    for channel in range(len(given["sigma_t"])):
        found, seconds = measure(scene(labels, given, channel), given, args.paths, channel)
        result["seconds"] += seconds
        result["radiance"].append(float(found.mean()))
        # Of the paths; the points are the same for all that are compared.
        variance = found.astype(np.float64).var(axis=1, ddof=1).mean()
        result["std_error"].append(float(np.sqrt(variance / args.paths / len(found))))
    result["seconds"] /= len(given["sigma_t"]) * len(given["points"]) * args.paths
    print(json.dumps(result))


if __name__ == "__main__":
    main()
