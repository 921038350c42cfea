"""Where are the corners in simulated images? Renderer, detector and truth, told apart.

    uv run python bench/render_accuracy.py [--samples 64]

Views without noise, near to far, straight and tilted, through three lenses. `reference` is drawn
by brute force: many rays per pixel (64: as 8 x 8), each looked up in the print itself, without a
texture. `truth` is the projection of the board's points. The plugin's detector finds the corners
in both images: reference - truth is the detector's own error, simulated - reference what the
renderer adds to it. The same is said with sub-pixel saddle points found from the true corners
(`cv2.cornerSubPix`), which is independent of the detector. Units: px, per axis.
"""

from __future__ import annotations

import argparse

import numpy as np

from rigcal.geometry import se3
from rigcal.scene import Scene
from rigcal.targets import BUILTIN_TARGETS
from rigcal_camera import CAMERA, CameraConfig, CameraEffects, lens_of
from rigcal_camera.corners import refine_saddles
from rigcal_camera.effects import expose
from rigcal_camera.simulator import BLACK, SKY, WHITE

TYPES = {kind.name: kind for kind in BUILTIN_TARGETS}
SHAPES = {
    "tags": (
        "apriltag_grid",
        {"columns": 6, "rows": 4, "tag_size_m": 0.15, "tag_gap_m": 0.04},
    ),
    "chess": ("checkerboard", {"columns": 10, "rows": 7, "square_size_m": 0.1}),
}
LENSES = {
    "pinhole": {},
    "barrel": {"distortion": (-0.28, 0.08, 0.0005, -0.0004, -0.01)},
    "fisheye": {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)},
}
EFFECTS = CameraEffects(noise_grey=0)
DISTANCES_M = (0.8, 1.2, 1.8, 2.7)
TILTS_DEG = ((0, 0, 0), (7, 25, -15), (-12, -40, 20), (30, 20, 45))


def camera(**lens):
    size = {"width_px": 616, "height_px": 512}
    return CameraConfig(focal_px=(300.0, 300.0), principal_px=(307.5, 255.5), **size, **lens)


def pose(distance_m, tilt_deg):
    R = np.diag([1.0, -1.0, -1.0]) @ se3.rotation_from_rpy(np.radians(tilt_deg))
    return se3.transform(R, np.array([0.031 * distance_m, -0.017 * distance_m, distance_m]))


def printed_grey(target, xy):
    """Grey of the print at (N, 2) points, exactly: the cells between all edges of its patches."""
    edges = [np.unique(np.concatenate([p.polygon[:, i] for p in target.patches])) for i in (0, 1)]
    cells = np.ones((len(edges[0]) + 1, len(edges[1]) + 1), dtype=np.float32)
    for patch in target.patches:
        low, high = patch.polygon.min(axis=0), patch.polygon.max(axis=0)
        (i0, i1), (j0, j1) = (
            np.searchsorted(e, (a, b)) for e, a, b in zip(edges, low, high, strict=True)
        )
        cells[i0 + 1 : i1 + 1, j0 + 1 : j1 + 1] = patch.grey
    return cells[np.searchsorted(edges[0], xy[:, 0]), np.searchsorted(edges[1], xy[:, 1])]


def reference(target, T_s_t, config, samples):
    """The light (H, W) by brute force: rays of a Hammersley set, `samples` in each pixel."""
    lens, T_t_s = lens_of(config), se3.inverse(T_s_t)
    low, high = target.outline.min(axis=0), target.outline.max(axis=0)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(lens.width), np.arange(lens.height)))
    edge = np.linspace(0, 1, 25)[:, None]
    corners = target.outline_points
    outline = np.concatenate(
        [a + edge * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)]
    )
    uv = lens.pixels_from_points(se3.apply(T_s_t, outline))[0]
    near = (u > uv[:, 0].min() - 2) & (u < uv[:, 0].max() + 2)
    near &= (v > uv[:, 1].min() - 2) & (v < uv[:, 1].max() + 2)
    total = np.full(len(u), SKY * samples)
    total[near] = 0
    for i in range(samples):
        du, dv = (i + 0.5) / samples - 0.5, radical_inverse(i) + 0.5 / samples - 0.5
        d_t = lens.rays_from_pixels(np.column_stack([u[near] + du, v[near] + dv])) @ T_t_s[:3, :3].T
        xy = T_t_s[:2, 3] - T_t_s[2, 3] / d_t[:, 2:] * d_t[:, :2]
        on = ((xy > low) & (xy < high)).all(axis=1)
        total[near] += np.where(on, printed_grey(target, xy), SKY)
    light = BLACK + total.reshape(lens.height, lens.width) / samples * (WHITE - BLACK)
    return light.astype(np.float32)


def radical_inverse(i):
    """The binary digits of i behind the point (van der Corput)."""
    return sum(((i >> k) & 1) / 2 ** (k + 1) for k in range(16))


def detected(image, config, target, T_s_t):
    """Pixels (N, 2) of the target's points in the image, NaN where not found."""
    uv = np.full((len(target.points), 2), np.nan)
    candidates = CAMERA.detect(image, config, target).candidates
    if candidates:
        errors = [CAMERA.errors(c, config, target, T_s_t) for c in candidates]
        best = candidates[int(np.argmin([np.sum(e**2) for e in errors]))]
        uv[best.measurement["index"]] = best.measurement["uv"]
    return uv


def saddles(image, truth, spacing):
    return refine_saddles(image, truth, np.full(len(truth), 0.4 * spacing))


def spacing_px(uv):
    gap = np.linalg.norm(uv[:, None] - uv[None], axis=2)
    return np.median(np.sort(gap, axis=1)[:, 1])


def errors_of_view(target, T_s_t, config, samples):
    """Detector alone, renderer alone, both together, (N, 2) each; None: the view is of no use."""
    lens, rng = lens_of(config), np.random.default_rng(0)
    p_s = se3.apply(T_s_t, target.points)
    if not lens.sees(p_s).all():
        return None
    truth = lens.pixels_from_points(p_s)[0]
    simulated = CAMERA.simulate(np.eye(4), Scene(target, T_s_t), config, rng, EFFECTS)
    exact = expose(reference(target, T_s_t, config, samples), lens, EFFECTS, rng)
    grey = np.abs(simulated.astype(float) - exact)
    a, b = (detected(image, config, target, T_s_t) for image in (simulated, exact))
    result = {"detector": b - truth, "renderer": a - b, "together": a - truth}
    if target.config.type == "checkerboard":
        c, d = (saddles(image, truth, spacing_px(truth)) for image in (simulated, exact))
        result |= {"saddle finder": d - truth, "renderer, by saddles": c - d}
    return result, grey[grey > 0].sum() / (grey > 0).sum().clip(1), grey.max()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=64, help="rays per pixel")
    parser.add_argument("--each", action="store_true", help="one line per view too")
    arguments = parser.parse_args()
    for shape, (kind, fields) in SHAPES.items():
        fields = {"type": kind, "width_m": 1.2, "height_m": 0.9, **fields}
        target = TYPES[kind].build("board", TYPES[kind].config(**fields))
        for name, lens in LENSES.items():
            every = {}
            worst = 0
            for distance in DISTANCES_M:
                for tilt in TILTS_DEG:
                    answer = errors_of_view(
                        target, pose(distance, tilt), camera(**lens), arguments.samples
                    )
                    if answer is None:
                        continue
                    errors, mean, most = answer
                    worst = max(worst, most)
                    for key, e in errors.items():
                        every.setdefault(key, []).append(e[np.isfinite(e).all(axis=1)])
                    if arguments.each:
                        line = "  ".join(f"{k} {summary(e)}" for k, e in errors.items())
                        print(
                            f"  {distance:3.1f} m {tilt!s:14} grey {mean:.2f} {most:3.0f}  {line}"
                        )
            print(f"{shape}, {name}: {len(every['together'])} views, grey off by <= {worst:.0f}")
            for key, e in every.items():
                print(f"    {key:22} {summary(np.concatenate(e))}")


def summary(e):
    e = e[np.isfinite(e).all(axis=1)]
    if not len(e):
        return "nothing found"
    bias = np.abs(e.mean(axis=0)).max()
    return f"rms {np.sqrt(np.mean(e**2)):.4f} max {np.abs(e).max():.4f} bias {bias:.4f}"


if __name__ == "__main__":
    main()
