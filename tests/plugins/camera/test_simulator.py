import numpy as np
import pytest

from rigcal.geometry import se3
from rigcal.scene import Cylinder, Scene, Sphere, Surface
from rigcal.targets.target import Patch, Target, TargetConfig
from rigcal_camera import CAMERA, lens_of
from rigcal_camera.simulator import BLACK, SKY, WHITE, arriving_light

BARREL = (-0.28, 0.08, 0.0005, -0.0004)
FISHEYE = {"model": "fisheye", "distortion": (-0.054, -0.078, 0.096, -0.0515)}
SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])


def facing_surface(distance_m, half_m, grey, at=(0.0, 0.0)):
    T = se3.transform(np.diag([1.0, -1, -1]), np.array([*at, distance_m]))
    return Surface(T, SQUARE * half_m, grey)


@pytest.mark.parametrize("distance_m", [0.7, 0.93, 1.4, 2.2, 3.1, 5.7])
def test_edges_are_where_they_are_printed(distance_m, camera):
    """Edges along the pixels' rows and columns, at any phase: the hardest ones to draw.

    The light that a black square takes away says where its four edges are, without any detector.
    """
    side, outline = 0.3, SQUARE * 0.4
    square = Patch(outline * side / 0.8, 0.0)
    target = Target(
        "square", TargetConfig(type="square"), outline, np.zeros((0, 3)), {}, (), (square,)
    )
    config = camera(focal_px=(450.0, 450.0))
    for shift in np.linspace(0, 0.9, 7):
        at = np.array([shift * distance_m / 450, -0.37 * shift * distance_m / 450, distance_m])
        scene = Scene(target, se3.transform(np.diag([1.0, -1, -1]), at))
        light = arriving_light(np.eye(4), scene, config, board_px_per_mm=3.0)
        half = int(0.35 * 450 / distance_m)
        u, v = np.meshgrid(np.arange(320 - half, 320 + half), np.arange(256 - half, 256 + half))
        dark = (WHITE - light[v, u]) / (WHITE - BLACK)
        width = np.sqrt(dark.sum())
        assert width == pytest.approx(450 * side / distance_m, abs=0.01)
        middle = [(dark * w).sum() / dark.sum() for w in (u, v)]
        expected = 450 * at[:2] / distance_m + config.principal_px
        np.testing.assert_allclose(middle, expected, atol=0.01)


@pytest.mark.parametrize(
    "lens", [{}, {"distortion": BARREL}, FISHEYE], ids=["plain", "barrel", "fisheye"]
)
@pytest.mark.parametrize("distance_m", [0.9, 1.7, 3.1])
def test_corners_are_where_the_lens_puts_them(distance_m, lens, board, camera, pose, photograph):
    """An independent corner finder, without noise: no bias of the rendering at any distance."""
    target, config = board["chess"], camera(**lens)
    T_s_t = pose((15, -25, 8), (0.03, -0.02, distance_m))
    image = photograph(target, T_s_t, config, noise_grey=0)
    (found,) = CAMERA.detect(image, config, target).candidates
    error = CAMERA.errors(found, config, target, T_s_t)
    assert len(error) == len(target.points)
    assert np.abs(error.mean(axis=0)).max() < 0.01
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_features_without_noise_have_no_residual(board, camera, pose):
    config = camera(distortion=BARREL, sigma_px=1e-12)
    T_s_t = pose((15, -25, 8), (0.03, -0.02, 1.5))
    seen = CAMERA.observe(T_s_t, config, board["april"], np.random.default_rng(0))
    assert np.abs(CAMERA.errors(seen, config, board["april"], T_s_t)).max() < 1e-9


def test_the_board_ends_at_its_outline(board, camera, pose, photograph):
    """The grey that the board adds to the background is the area of its white, in pixels."""
    target, config = board["chess"], camera()
    T_s_t = pose((0, 0, 7), (0.01, 0, 2.0))
    image = photograph(target, T_s_t, config, noise_grey=0, blur_px=0).astype(np.float64)
    background, white, black = image[0, 0], image.max(), image.min()
    px2_per_m2 = (450 / 2) * (455 / 2)
    black_area = 27 * 0.1**2
    white_area = target.size.prod() - black_area
    expected = white_area * (white - background) + black_area * (black - background)
    assert np.sum(image - background) == pytest.approx(expected * px2_per_m2, rel=0.003)


def test_surfaces_have_their_grey_and_hide_what_is_behind(board, camera, pose, photograph):
    target, config = board["april"], camera()
    T_s_t = pose((0, 10, 0), (0, 0, 1.5))
    wall = facing_surface(3.0, 5.0, 0.7)
    hand = facing_surface(1.2, 0.12, 0.2, at=(0.25, 0.0))
    free = photograph(target, T_s_t, config, (wall,), noise_grey=0)
    hidden = photograph(target, T_s_t, config, (wall, hand), noise_grey=0)
    uv = lens_of(config).pixels_from_points(np.array([[0.25, 0, 1.2]]))[0][0].astype(int)
    assert hidden[uv[1], uv[0]] == 20 + round(0.2 * 210)
    assert hidden[5, 5] == free[5, 5] == 20 + round(0.7 * 210)
    seen = [CAMERA.detect(i, config, target).candidates[0].measurement for i in (free, hidden)]
    assert len(seen[0]["index"]) == 48
    assert 24 <= len(seen[1]["index"]) < 48
    common = np.isin(seen[0]["index"], seen[1]["index"])
    order = np.argsort(seen[1]["index"])
    free_uv = seen[0]["uv"][common][np.argsort(seen[0]["index"][common])]
    # A tag half hidden may stay with an error below the smallest that is taken for an outlier.
    assert np.abs(free_uv - seen[1]["uv"][order]).max() < 0.5


def test_a_surface_behind_the_board_hides_nothing(board, camera, pose, photograph):
    target, config, T_s_t = board["april"], camera(), pose((20, 10, 0), (0, 0, 1.5))
    behind = facing_surface(2.2, 3.0, 0.5)
    measurement = (
        CAMERA.detect(photograph(target, T_s_t, config, (behind,)), config, target)
        .candidates[0]
        .measurement
    )
    assert len(measurement["index"]) == 48


def covered(light, grey, behind):
    """Pixels' worth of something grey before something else."""
    return np.sum(light - behind) / ((grey - behind) * 1.0)


def level(grey):
    return BLACK + grey * (WHITE - BLACK)


@pytest.mark.parametrize("shift_px", [0.0, 0.3, 0.75])
def test_things_cover_the_share_of_each_pixel_that_is_theirs(shift_px, board, camera, pose):
    """Before the sky and before the white back of the board, a box's face 40.6 px wide."""
    hand = facing_surface(1.0, 0.0451, 0.9, at=(0.2 + shift_px / 450, 0.1))
    area = (2 * 0.0451) ** 2 * 450 * 455
    bare = Scene(board["april"], None, (hand,))
    light = arriving_light(np.eye(4), bare, camera(), 3.0)
    assert covered(light, level(0.9), level(SKY)) == pytest.approx(area, rel=0.01)
    back = se3.transform(np.eye(3), np.array([0, 0, 1.5]))
    dark_hand = facing_surface(1.0, 0.0451, 0.1, at=(0.02 + shift_px / 450, 0.1))
    light = arriving_light(np.eye(4), Scene(board["april"], back, (dark_hand,)), camera(), 3.0)
    part = light[240:345, 260:400]
    assert covered(part, level(0.1), level(1.0)) == pytest.approx(area, rel=0.01)


def test_thin_and_small_things_are_seen_in_whole(board, camera):
    """A rod 3 px wide that leans, and a ball 4 px wide."""
    lean = se3.rotation_from_rpy(np.array([np.radians(65), np.radians(20), 0.0]))
    rod = Cylinder(se3.transform(lean, np.array([-0.2, 0.0, 1.5])), 0.005, 0.9, 0.0)
    ball = Sphere(se3.transform(np.eye(3), np.array([0.4, 0.3, 1.5])), 0.0067, 1.0)
    scene = Scene(board["april"], None, (), (rod, ball))
    light = arriving_light(np.eye(4), scene, camera(), 3.0)
    rows = np.flatnonzero((light < level(SKY) - 1).any(axis=1))
    assert len(rows) > 200
    assert (np.diff(rows) == 1).all()
    assert light[rows[3:-3]].min(axis=1).max() < level(0.3 * SKY)
    spot = light[320:380, 420:460]
    assert covered(spot, level(1.0), level(SKY)) == pytest.approx(np.pi * 2.01**2, rel=0.15)


def test_pictures_are_seen_through_the_lens_and_averaged(board, camera):
    texture = (np.indices((40, 40)).sum(axis=0) % 2 * 255).astype(np.uint8)
    wall = facing_surface(1.0, 0.4, 0.5)
    near = Surface(wall.T_w_f, wall.polygon, 0.5, texture)
    light = arriving_light(np.eye(4), Scene(board["april"], None, (near,)), camera(), 3.0)
    uv = lens_of(camera()).pixels_from_points(np.array([[0.01, 0.01, 1.0], [0.03, 0.01, 1.0]]))[0]
    greys = light[tuple(np.round(uv).astype(int).T[::-1])]
    assert sorted(greys) == pytest.approx([BLACK, WHITE], abs=5)
    far = Surface(facing_surface(20.0, 0.4, 0.5).T_w_f, wall.polygon, 0.5, texture)
    light = arriving_light(np.eye(4), Scene(board["april"], None, (far,)), camera(), 3.0)
    assert light[256, 320] == pytest.approx(level(0.5), abs=15)


def test_pixels_that_the_lens_does_not_reach_are_dark(board, camera):
    config = camera(model="fisheye", focal_px=(60.0, 60.0))
    light = arriving_light(np.eye(4), Scene(board["april"], None), config, 3.0)
    assert light[0, 0] == 0
    assert light[256, 320] == np.float32(level(SKY))


def test_the_seed_decides_the_noise(board, camera, pose, photograph):
    target, config = board["april"], camera()
    a, b, c = (photograph(target, pose(), config, seed=seed) for seed in (1, 1, 2))
    assert a.dtype == np.uint8
    assert a.shape == (512, 640)
    np.testing.assert_array_equal(a, b)
    assert np.std(a[:50].astype(float) - c[:50]) == pytest.approx(2 * 2**0.5, rel=0.1)


def test_the_back_of_the_board_is_blank(board, camera, photograph):
    back = se3.transform(np.eye(3), np.array([0, 0, 1.5]))
    image = photograph(board["april"], back, camera(), noise_grey=0)
    assert image[256, 320] == 230
    assert len(np.unique(image[200:300, 250:400])) == 1


def test_boards_across_and_behind_the_lens_are_drawn_as_far_as_seen(
    board, camera, pose, photograph
):
    fisheye = camera(model="fisheye")
    empty = photograph(board["april"], None, fisheye, noise_grey=0)
    beside = se3.transform(
        se3.rotation_from_rpy(np.array([0, -np.pi / 2, 0])), np.array([0.5, 0, 0.2])
    )
    image = photograph(board["april"], beside, fisheye, noise_grey=0)
    assert image[256, 639] > 200
    np.testing.assert_array_equal(image[:, :560], empty[:, :560])
    for distance_m in (-1.5, 0.0):
        image = photograph(board["april"], pose(translation=(0, 0, distance_m)), camera())
        assert image.shape == (512, 640)


def test_sees_only_what_is_in_the_image(camera):
    p = np.array([[0, 0, 1.0], [0, 0, -1.0], [0.7, 0, 1.0], [0.72, 0, 1.0]])
    assert CAMERA.sees(p, camera()).tolist() == [True, False, True, False]
