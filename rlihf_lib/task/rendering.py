"""Pictures of the scene, off-screen.

MuJoCo chooses its OpenGL library when it is first imported, and a missing one can end the process;
so a picture is rendered in a process of its own, with EGL or else OSMesa.
"""

import os
import subprocess
import sys
from pathlib import Path

BACKENDS = ("egl", "osmesa")
WIDTH, HEIGHT = 960, 720  # pixels


def render(path, seed=0):
    """Render the scene as the person facing the robot sees it.

    Parameters
    ----------
    path : Path
        PNG file to write.
    seed : int
        Of the placement.

    Returns
    -------
    str
        The OpenGL library used; empty, and no file written, where there is none.
    """
    for backend in BACKENDS:
        environment = {**os.environ, "MUJOCO_GL": backend, "PYOPENGL_PLATFORM": backend}
        command = [sys.executable, "-m", __spec__.name, str(path), str(seed)]
        done = subprocess.run(command, env=environment, capture_output=True, check=False)
        if done.returncode == 0 and Path(path).is_file():
            return backend
    return ""


def _render_here(path, seed):
    import matplotlib.image
    import mujoco

    from rlihf_lib.files import atomic_path
    from rlihf_lib.task.gym_env import PickPlaceEnv

    env = PickPlaceEnv()
    env.reset(seed=seed)
    env.model.vis.global_.offwidth, env.model.vis.global_.offheight = WIDTH, HEIGHT
    camera = mujoco.MjvCamera()
    camera.lookat[:] = [-0.2, 0.0, 1.0]
    camera.distance, camera.azimuth, camera.elevation = 1.6, 160.0, -25.0
    options = mujoco.MjvOption()
    options.geomgroup[0], options.geomgroup[1] = 0, 1  # meshes, not collision shapes
    options.sitegroup[:] = 0
    with mujoco.Renderer(env.model, HEIGHT, WIDTH) as renderer:
        renderer.update_scene(env.data, camera, options)
        pixels = renderer.render()
    with atomic_path(path) as temporary:
        matplotlib.image.imsave(temporary, pixels)


if __name__ == "__main__":
    _render_here(sys.argv[1], int(sys.argv[2]))
