"""Pictures of the scene and of rollouts in it, off-screen.

MuJoCo chooses its OpenGL library when it is first imported, and a missing one can end the process;
so they are rendered in a process of their own, with EGL or else OSMesa.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

# Width and height, pixels; what the camera looks at, its distance, m; azimuth, elevation, degrees.
PICTURE = (1050, 1050, (-0.2, 0.0, 1.14), 1.3, 198.0, -32.0)
FILM_CAMERA = ((-0.15, 0.0, 1.0), 1.05, 198.0, -28.0)


def render(path: str | Path, seed: int = 0) -> str:
    """Render the placement of a seed, as the person facing the robot sees it, to a PNG file.

    Return the OpenGL library used; empty, and no file written, where there is none.
    """
    return _in_own_process(path, seed)


def project(points: np.ndarray) -> np.ndarray:
    """Where points of the world, (n, 3), are in the picture of `render`: pixels from upper left."""
    width, height, lookat, distance, azimuth, elevation = PICTURE
    ahead, left, up = Rotation.from_euler("yz", [-elevation, azimuth], degrees=True).as_matrix().T
    seen = points - lookat + distance * ahead
    focal = height / 2 / np.tan(np.radians(45 / 2))  # MuJoCo's field of view, upwards: 45 degrees
    across = focal * (seen @ np.stack([left, up], axis=1)) / (seen @ ahead)[:, None]
    return np.array([width, height]) / 2 - across


def render_rollout(qpos: np.ndarray, seed: int, width: int, height: int) -> np.ndarray | None:
    """Render a rollout in the placement of a seed; None where there is no OpenGL library.

    `qpos` are generalised positions, (n, nq), as in `rlihf_lib.rl.evaluation.Recording`. Returns
    RGB pictures, uint8, (n, height, width, 3).
    """
    with tempfile.TemporaryDirectory() as folder:
        positions, pictures = Path(folder) / "qpos.npy", Path(folder) / "pictures.npy"
        np.save(positions, qpos)
        done = _in_own_process(pictures, seed, positions, width, height)
        return np.load(pictures) if done else None


def _in_own_process(*arguments):
    for backend in ("egl", "osmesa"):
        environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
        command = [sys.executable, "-m", __spec__.name, *map(str, arguments)]
        done = subprocess.run(command, env=environment, capture_output=True)
        if done.returncode == 0 and Path(arguments[0]).is_file():
            return backend
    return ""


def _render_here(path, seed, positions=None, *size):
    import mujoco
    from PIL import Image

    from rlihf_lib.files import atomic_path
    from rlihf_lib.task.gym_env import PickPlaceEnv
    from rlihf_lib.task.workspace import Workspace

    env = PickPlaceEnv(workspace=Workspace(fast=False))  # the fast one has no visual meshes
    env.reset(seed=int(seed))
    width, height = map(int, size or PICTURE[:2])
    env.model.vis.global_.offwidth, env.model.vis.global_.offheight = width, height
    camera = mujoco.MjvCamera()
    view = FILM_CAMERA if positions else PICTURE[2:]
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = view
    options = mujoco.MjvOption()
    options.geomgroup[0], options.geomgroup[1] = 0, 1  # meshes, not collision shapes
    options.sitegroup[:] = 0
    frames = []
    with mujoco.Renderer(env.model, height, width) as renderer:
        for qpos in np.load(positions) if positions else [env.data.qpos.copy()]:
            env.data.qpos[:] = qpos
            mujoco.mj_forward(env.model, env.data)
            renderer.update_scene(env.data, camera, options)
            frames.append(renderer.render())
    if positions:
        return np.save(path, frames)
    with atomic_path(path) as temporary:
        Image.fromarray(frames[0]).save(temporary, "PNG")


if __name__ == "__main__":
    _render_here(*sys.argv[1:])
