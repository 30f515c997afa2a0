"""Cameras: a twin in numpy, round trips, and what moving an image does to its camera."""

import math

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor
from torch.nn.functional import interpolate

from col3d.data.datasets.octagon import octagon_mask
from col3d.geometry import (
    Camera,
    FisheyeCamera,
    OmnidirectionalCamera,
    PinholeCamera,
    RadialTangentialCamera,
    normals_from_depth,
)

FISHEYE = ((717.2, 716.1), (672.4, 541.7), (-0.04, 0.011, -0.004, 0.0007))
"""Focal lengths, centre, k1 to k4."""
RADIAL_TANGENTIAL = (
    *((702.0, 705.5), (671.3, 538.2)),
    *((-0.12, 0.031, 0.004, 0.11, -0.015, 0.002), (0.0031, -0.0017)),
)
"""Focal lengths, centre, k1 to k6, p1 and p2."""
CAMERAS = {
    "pinhole": PinholeCamera.c3vd(),
    "omnidirectional": OmnidirectionalCamera.c3vd(),
    "omnidirectional_v2": OmnidirectionalCamera.c3vdv2(),
    "fisheye": FisheyeCamera.from_focal((1080, 1350), *FISHEYE),
    "radial_tangential": RadialTangentialCamera.from_focal((1080, 1350), *RADIAL_TANGENTIAL),
}
OMNIDIRECTIONAL = {
    "omnidirectional": (
        [678.544839263292, 542.975887548343],
        (0.999986882249990, 0.00288273829525059, -0.00296316513429569),
        *(769.243600037458, -0.000812770624150226, 6.25674244578925e-07, -1.19662182144280e-09),
    ),
    "omnidirectional_v2": (
        [677.739464094188, 543.057997844875],
        (0.9999, 1.10e-4, -1.83e-4),
        *(767.733695862103, -0.000592506426558248, -2.69440266600040e-07, -2.16380341010063e-10),
    ),
}
"""Centre; c, d, e of the stretch [[c, e], [d, 1]]; a0, a2, a3, a4: the published calibrations."""
CHAINS: dict[str, list[tuple[str, tuple[float, ...]]]] = {
    "as it is": [],
    "resized": [("resized", (320, 320))],
    "enlarged": [("resized", (2000, 1500))],
    "cropped": [("cropped", (100, 200, 800, 900))],
    "flipped": [("flipped", ())],
    "rolled": [("rolled", (17.0,))],
    "long": [
        ("rolled", (-30.0,)),
        ("cropped", (40, 60, 900, 1100)),
        ("flipped", ()),
        ("resized", (256, 300)),
        ("rolled", (5.0,)),
        ("flipped", ()),
    ],
}


def moved(camera: Camera, chain: str) -> Camera:
    for step, arguments in CHAINS[chain]:
        if step == "resized":
            camera = camera.resized((int(arguments[0]), int(arguments[1])))
        else:
            camera = getattr(camera, step)(*arguments)
    return camera


def moved_twin(pixels: np.ndarray, chain: str) -> tuple[np.ndarray, np.ndarray]:
    """Where pixels of the 1080 x 1350 frame go, and the matrix that vectors turn by."""
    (height, width), turn = (1080.0, 1350.0), np.eye(3)
    u, v = pixels.T
    for step, arguments in CHAINS[chain]:
        if step == "resized":
            new_height, new_width = arguments
            u, v = (u + 0.5) * new_width / width - 0.5, (v + 0.5) * new_height / height - 0.5
            height, width = new_height, new_width
        elif step == "cropped":
            top, left, height, width = arguments
            u, v = u - left, v - top
        elif step == "flipped":
            u, turn = width - 1 - u, np.diag([-1.0, 1.0, 1.0]) @ turn
        else:
            cos, sin = math.cos(math.radians(arguments[0])), math.sin(math.radians(arguments[0]))
            x, y = u - (width - 1) / 2, v - (height - 1) / 2
            u, v = cos * x - sin * y + (width - 1) / 2, sin * x + cos * y + (height - 1) / 2
            turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]]) @ turn
    return np.stack([u, v], axis=1), turn


def rays_twin(kind: str, pixels: np.ndarray) -> np.ndarray:
    """Rays from the published calibrations, pixel by pixel; those of distorted lenses by OpenCV."""
    if kind in ("fisheye", "radial_tangential"):
        matrix, vector = opencv_numbers(kind)
        undistort = cv2.fisheye.undistortPoints if kind == "fisheye" else cv2.undistortPoints
        plane = undistort(pixels[:, None], matrix, vector, criteria=(3, 1000, 1e-14))[:, 0]
        rays = np.column_stack([plane, np.ones(len(plane))])
    elif kind == "pinhole":
        rays = np.stack(
            [
                (pixels[:, 0] - 675.226397736271) / 769.807403688120,
                (pixels[:, 1] - 548.903474592445) / 769.720558534159,
                np.ones(len(pixels)),
            ],
            axis=1,
        )
    else:
        centre, (c, d, e), a0, a2, a3, a4 = OMNIDIRECTIONAL[kind]
        x, y = np.linalg.solve(np.array([[c, e], [d, 1.0]]), (pixels - centre).T)
        r = np.hypot(x, y)
        rays = np.stack([x, y, a0 + a2 * r**2 + a3 * r**3 + a4 * r**4], axis=1)
    unit_rays: np.ndarray = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return unit_rays


def opencv_numbers(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """K, and distortion in OpenCV's order."""
    (fx, fy), (cx, cy), *rest = FISHEYE if kind == "fisheye" else RADIAL_TANGENTIAL
    vector: list[float] = list(rest[0])
    if kind == "radial_tangential":
        k1, k2, k3, k4, k5, k6 = rest[0]
        vector = [k1, k2, *rest[1], k3, k4, k5, k6]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.array(vector)


def octagon_pixels(count: int = 5000) -> np.ndarray:
    inside = octagon_mask()[0].numpy()
    v, u = np.nonzero(inside)
    chosen = np.random.default_rng(0).choice(len(u), count, replace=False)
    return np.stack([u[chosen], v[chosen]], axis=1).astype(np.float64)


@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("kind", CAMERAS)
def test_rays_are_those_of_the_calibration(kind: str, chain: str) -> None:
    pixels = octagon_pixels()
    there, turn = moved_twin(pixels, chain)
    found = moved(CAMERAS[kind], chain).unproject(torch.from_numpy(there)).numpy()
    np.testing.assert_allclose(found, rays_twin(kind, pixels) @ turn.T, atol=1e-12, rtol=0)


@pytest.mark.parametrize("kind", ["fisheye", "radial_tangential"])
def test_projections_are_those_of_opencv(kind: str) -> None:
    points = np.random.default_rng(1).normal(size=(4000, 3)) * [0.8, 0.8, 0.3] + [0, 0, 1.4]
    points = points[(points[:, 2] > 0.2) & (np.hypot(points[:, 0], points[:, 1]) < 2 * points[:, 2])]
    matrix, vector = opencv_numbers(kind)
    project = cv2.fisheye.projectPoints if kind == "fisheye" else cv2.projectPoints
    pixels = project(points[:, None], np.zeros(3), np.zeros(3), matrix, vector)[0][:, 0]
    found = CAMERAS[kind].project(torch.from_numpy(points)).numpy()
    seen = np.isfinite(found).all(axis=1)
    assert seen.sum() > 3000
    np.testing.assert_allclose(found[seen], pixels[seen], atol=1e-9, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("chain", CHAINS)
@pytest.mark.parametrize("kind", CAMERAS)
def test_projecting_undoes_unprojecting(kind: str, chain: str, dtype: torch.dtype) -> None:
    camera = moved(CAMERAS[kind], chain)
    pixels = torch.from_numpy(moved_twin(octagon_pixels(), chain)[0]).to(dtype)
    rays = camera.unproject(pixels)
    for scale in (1.0, 83.0):
        again = camera.project(rays * scale)
        assert again.dtype == dtype
        assert (again - pixels).abs().max() < (1e-3 if dtype == torch.float32 else 1e-9)


def test_widest_ray_of_the_octagon() -> None:
    ahead = CAMERAS["omnidirectional"].rays()[2][octagon_mask()[0]]
    assert math.degrees(math.acos(ahead.min().item())) == pytest.approx(73.0, abs=0.5)


@pytest.mark.parametrize("kind", CAMERAS)
def test_rays_of_the_whole_image(kind: str) -> None:
    camera = CAMERAS[kind].resized((54, 70))
    rays = camera.rays()
    assert rays.dtype == torch.float32
    assert rays.shape == (3, 54, 70)
    torch.testing.assert_close(rays.norm(dim=0), torch.ones(54, 70), atol=1e-6, rtol=0)
    pixel = torch.tensor([11.0, 47.0], dtype=torch.float64)
    torch.testing.assert_close(rays[:, 47, 11], camera.unproject(pixel).float())
    assert CAMERAS[kind].resized((54, 70)).rays() is rays


def test_rays_first_asked_for_in_inference_mode_serve_training() -> None:
    camera = PinholeCamera.from_focal((4, 5), 3.0, 3.0, 2.0, 1.5)
    with torch.inference_mode():
        rays = camera.rays()
    depth = torch.ones(1, 1, 4, 5, requires_grad=True)
    (depth * rays).sum().backward()
    assert depth.grad is not None


@pytest.mark.parametrize("kind", CAMERAS)
@pytest.mark.parametrize("size_hw", [(540, 675), (320, 320), (2160, 1000)])
def test_resizing_shifts_by_half_a_pixel(kind: str, size_hw: tuple[int, int]) -> None:
    """Corners of the image stay corners, and pixel centres are where image resampling reads them."""
    camera, small = CAMERAS[kind], CAMERAS[kind].resized(size_hw)
    corners = torch.tensor([[-0.5, -0.5], [1349.5, 1079.5]], dtype=torch.float64)
    small_corners = torch.tensor([[-0.5, -0.5], [size_hw[1] - 0.5, size_hw[0] - 0.5]], dtype=torch.float64)
    torch.testing.assert_close(small.unproject(small_corners), camera.unproject(corners))

    columns = torch.arange(1350, dtype=torch.float64).expand(1, 1, 2, 1350)
    read = interpolate(columns, (2, size_hw[1]), mode="bilinear", align_corners=False)[0, 0, 0, 5:-5]
    there = torch.stack([read, torch.full_like(read, 539.5)], dim=1)
    here = torch.stack(
        [torch.arange(5.0, size_hw[1] - 5), torch.full_like(read, size_hw[0] / 2 - 0.5)], dim=1
    )
    torch.testing.assert_close(small.unproject(here.double()), camera.unproject(there), atol=1e-9, rtol=0)


@pytest.mark.parametrize("kind", CAMERAS)
def test_moves_that_cancel(kind: str) -> None:
    camera = CAMERAS[kind]
    for same in (
        camera.flipped().flipped(),
        camera.rolled(33.0).rolled(-33.0),
        camera.resized((300, 200)).resized(camera.size_hw),
        camera.cropped(0, 0, 1080, 1350),
    ):
        assert type(same) is type(camera)
        assert same.size_hw == camera.size_hw
        np.testing.assert_allclose(same.centre, camera.centre, atol=1e-9)
        np.testing.assert_allclose(same.stretch, camera.stretch, atol=1e-9)


def test_rays_of_moved_images_are_the_moved_rays() -> None:
    camera = CAMERAS["omnidirectional"].resized((60, 60))
    rays = camera.rays()
    assert torch.equal(camera.cropped(7, 11, 20, 30).rays(), rays[:, 7:27, 11:41])
    mirrored = rays.flip(-1) * torch.tensor([-1.0, 1.0, 1.0])[:, None, None]
    torch.testing.assert_close(camera.flipped().rays(), mirrored, atol=1e-6, rtol=0)
    turned = torch.rot90(rays, -1, (-2, -1))  # clockwise: what was right of the middle is below it
    turned = torch.stack([-turned[1], turned[0], turned[2]])
    torch.testing.assert_close(camera.rolled(90.0).rays(), turned, atol=1e-6, rtol=0)


@pytest.mark.parametrize("kind", CAMERAS)
def test_project_is_differentiable(kind: str) -> None:
    camera = CAMERAS[kind].resized((200, 300)).rolled(20.0)
    points = torch.tensor(
        [[0.0, 0.0, 40.0], [1e-3, 0.0, 30.0], [20.0, -30.0, 25.0], [-60.0, 10.0, 25.0]],
        dtype=torch.float64,
        requires_grad=True,
    )
    assert torch.autograd.gradcheck(camera.project, (points,))


@pytest.mark.parametrize("kind", CAMERAS)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_axis_behind_the_camera_has_no_pixel(kind: str, dtype: torch.dtype) -> None:
    behind = torch.tensor([[0, 0, -1], [0, 0, -50], [1e-10, 0, -1], [0, -1e-7, -3], [0, 0, 0]], dtype=dtype)
    assert CAMERAS[kind].project(behind).isnan().all()


def inside(camera: Camera, pixels: Tensor) -> Tensor:
    limit = torch.tensor([camera.size_hw[1] - 0.5, camera.size_hw[0] - 0.5], dtype=pixels.dtype)
    return ((pixels >= -0.5) & (pixels <= limit)).all(dim=-1)


@pytest.mark.parametrize("kind", CAMERAS)
def test_what_projects_into_the_image_is_seen_there(kind: str) -> None:
    """Directions all around: their pixels look back along them, and no point behind is in the octagon."""
    camera = CAMERAS[kind]
    points = torch.randn(20000, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    pixels = camera.project(points)
    caught = inside(camera, pixels)
    assert caught.sum() > 1000
    directions = points / points.norm(dim=1, keepdim=True)
    torch.testing.assert_close(camera.unproject(pixels[caught]), directions[caught], atol=1e-9, rtol=0)
    u, v = pixels[caught & (points[:, 2] <= 0)].round().long().T
    assert not octagon_mask()[0, v.clamp(0, 1079), u.clamp(0, 1349)].any()


@given(
    x=st.floats(-5, 5),
    y=st.floats(-5, 5),
    z=st.floats(-5, 5),
    kind=st.sampled_from(list(CAMERAS)),
)
@settings(max_examples=100, deadline=None)
def test_any_direction(x: float, y: float, z: float, kind: str) -> None:
    point = torch.tensor([[x, y, z]], dtype=torch.float64)
    pixel = CAMERAS[kind].project(point)
    if inside(CAMERAS[kind], pixel).all():
        back = CAMERAS[kind].unproject(pixel)
        torch.testing.assert_close(back * point.norm(), point, atol=1e-7, rtol=0)


def test_a_plane_under_a_pinhole_faces_it() -> None:
    camera = PinholeCamera.from_focal((8, 9), 10.0, 12.0, 4.3, 3.1)
    normals = normals_from_depth(torch.full((1, 1, 8, 9), 50.0), camera.rays())
    expected = torch.tensor([0.0, 0.0, -1.0]).view(1, 3, 1, 1).expand(1, 3, 8, 9)
    torch.testing.assert_close(normals, expected, atol=1e-5, rtol=0)


@pytest.mark.parametrize("kind", CAMERAS)
def test_unproject_is_differentiable(kind: str) -> None:
    camera = CAMERAS[kind].resized((200, 300))
    pixels = torch.tensor(
        [[150.3, 99.1], [31.0, 40.0], [270.0, 180.0]], dtype=torch.float64, requires_grad=True
    )
    assert torch.autograd.gradcheck(camera.unproject, (pixels,))


def test_a_fisheye_sees_beyond_ninety_degrees_but_no_depth_there() -> None:
    """r = f t: angles are radii, so that all is known in closed form."""
    camera = FisheyeCamera.from_focal((120, 160), (40.0, 40.0), (79.5, 59.5))
    v, u = torch.meshgrid(
        torch.arange(120, dtype=torch.float64), torch.arange(160, dtype=torch.float64), indexing="ij"
    )
    angle = torch.hypot(u - 79.5, v - 59.5) / 40.0
    pixels = torch.stack([u, v], dim=-1)
    rays = camera.unproject(pixels)
    torch.testing.assert_close(torch.arccos(rays[..., 2]), angle, atol=1e-9, rtol=0)
    assert angle.max() > math.radians(140)
    torch.testing.assert_close(camera.project(50 * rays), pixels, atol=1e-9, rtol=0)
    assert torch.equal(camera.sees()[0], angle < math.acos(1e-3))


@pytest.mark.parametrize(
    ("radial", "tangential"),
    [
        ((-0.3, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 0.0)),
        ((-0.3, 0.02, 0.0, 0.0, 0.0, 0.0), (0.004, -0.003)),
        ((0.2, -0.3, 0.0, 0.1, 0.0, 0.0), (0.0, 0.0)),
        ((0.1, 0.0, 0.0, 0.0, 0.0, 0.4), (0.0, 0.0)),
    ],
)
def test_distortion_is_used_up_to_where_it_folds(
    radial: tuple[float, float, float, float, float, float], tangential: tuple[float, float]
) -> None:
    """OpenCV projects points beyond the fold back into the image; here they have no pixel."""
    camera = RadialTangentialCamera.from_focal((96, 128), (75.0, 75.0), (63.5, 47.5), radial, tangential)
    k1, k2, k3, k4, k5, k6 = radial
    r = np.linspace(0, 5, 500001)
    ring = r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6) / (1 + k4 * r**2 + k5 * r**4 + k6 * r**6)
    fold = r[int(np.argmax(np.diff(ring) < 0))]
    assert camera.widest_tangent == pytest.approx(fold, abs=2e-5)
    vector = np.array([k1, k2, *tangential, k3, k4, k5, k6])
    matrix = np.array([[75.0, 0, 63.5], [0, 75.0, 47.5], [0, 0, 1]])
    points = np.array([[1.02 * fold, 0.0, 1.0], [0.0, -1.5 * fold, 1.0], [0.9 * fold, 0.0, 1.0]])
    folded = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, vector)[0]
    assert np.isfinite(folded).all()
    found = camera.project(torch.from_numpy(points))
    assert found[:2].isnan().all()
    torch.testing.assert_close(found[2], torch.from_numpy(folded[2, 0]), atol=1e-9, rtol=0)
    back = camera.unproject(found[2:])[0]
    torch.testing.assert_close(back / back[2], torch.from_numpy(points[2]), atol=1e-8, rtol=0)


def test_pixels_without_a_ray_have_that_of_the_rim() -> None:
    camera = RadialTangentialCamera.from_focal(
        (97, 129), (75.0, 75.0), (64.0, 48.0), (-0.3, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    rays, sees = camera.rays(), camera.sees()[0]
    v, u = np.mgrid[0:97, 0:129]
    rim = 75 * (fold := math.sqrt(1 / 0.9)) * (1 - 0.3 * fold**2)
    np.testing.assert_array_equal(sees.numpy(), np.hypot(u - 64, v - 48) < rim)
    assert rays.isfinite().all()
    torch.testing.assert_close(rays.norm(dim=0), torch.ones(97, 129))
    outside = rays[:, ~sees]
    torch.testing.assert_close(
        outside[:2].norm(dim=0) / outside[2], torch.full((int((~sees).sum()),), fold), atol=2e-3, rtol=0
    )
    along = torch.from_numpy(np.stack([u - 64.0, v - 48.0]))[:, ~sees].float()
    turned = outside[0] * along[1] - outside[1] * along[0]
    assert turned.abs().max() < 1e-3
