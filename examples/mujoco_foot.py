"""A hexapod walks in MuJoCo on our feet: its contact forces go in, what footsense would publish comes out, drawn.

pip install -e deploy/client -e '.[walkers]', then: python examples/mujoco_foot.py, or with the name of a picture.
"""

import argparse
import sys

try:
    import matplotlib.pyplot as plt
    import mujoco
    import numpy as np

    from footsense.sim import VirtualFeet
except ImportError as error:
    sys.exit(
        f"mujoco_foot.py needs {error.name}; in the clone of footsense: pip install -e deploy/client -e '.[walkers]'"
    )

LEGS = {"lf": (1, 1), "lm": (0, 1.2), "lr": (-1, 1), "rf": (1, -1), "rm": (0, -1.2), "rr": (-1, -1)}
TRIPOD = np.array([0.0, 0.5, 0.0, 0.5, 0.0, 0.5])  # phase of each leg
LEG = """<body pos="{0} {1} 0"><joint name="{2}_hip" axis="0 1 0" armature=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.1" size=".008" mass=".05" contype="0" conaffinity="0"/>
<body name="{2}" pos="0 0 -.1"><joint name="{2}_lift" type="slide" axis="0 0 1" armature=".5"/>
<geom name="{2}" size=".01" mass=".02" contype="0" friction=".8" solref=".02 .3"/></body></body>"""
MOTORS = """<position joint="{0}_hip" kp="20" kv=".8"/><position joint="{0}_lift" kp="2500" kv="80"/>"""
ROBOT = f"""<mujoco><option timestep=".002" integrator="implicitfast"/><worldbody>
<geom type="plane" size="9 9 1" conaffinity="0"/><body pos="0 0 .112"><freejoint/>
<geom type="box" size=".15 .08 .02" mass="1.5" contype="0" conaffinity="0"/>
{"".join(LEG.format(0.12 * x, 0.1 * y, leg) for leg, (x, y) in LEGS.items())}</body></worldbody>
<actuator>{"".join(map(MOTORS.format, LEGS))}</actuator></mujoco>"""

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("picture", nargs="?", default="mujoco_foot.png")
picture = arguments.parse_args().picture
model = mujoco.MjModel.from_xml_string(ROBOT)
data, feet = mujoco.MjData(model), VirtualFeet(len(LEGS), "hexapod-2kg", cable_breaks_per_s=0.2)
time_s, felt_n, told = [], [], []
while data.time < 4.0:
    phase = (data.time + TRIPOD) % 1.0
    swing, stance = np.clip(phase / 0.4, 0.0, 1.0), np.clip((phase - 0.4) / 0.6, 0.0, 1.0)
    data.ctrl[0::2] = 0.2 * (np.cos(np.pi * swing) + 2.0 * stance)
    data.ctrl[1::2] = 0.02 * np.sin(np.pi * swing) ** 2
    mujoco.mj_step(model, data)
    force_n, normal, wrench = np.zeros((6, 3)), np.tile([0.0, 0.0, 1.0], (6, 1)), np.zeros(6)
    for number, contact in enumerate(data.contact):
        leg, (ground, *_) = model.geom(contact.geom2).name, contact.frame.reshape(3, 3)
        mujoco.mj_contactForce(model, data, number, wrench)
        to_foot = data.body(leg).xmat.reshape(3, 3).T  # the foot's frame: x forward, y left, z up the leg
        force_n[list(LEGS).index(leg)] = to_foot @ contact.frame.reshape(3, 3).T @ wrench[:3]
        normal[list(LEGS).index(leg)] = to_foot @ ground
    time_s.append(data.time)
    felt_n.append(force_n[0, 2])  # the left front foot, along its leg
    told.append(feet.step(data.time, force_n, normal))

force_n, sigma_n = (np.array([getattr(one, name)[0, 2] for one in told]) for name in ("force_n", "sigma_n"))
figure, axes = plt.subplots(2, 1, figsize=(9, 6), layout="constrained")
for axis, (first_s, last_s) in zip(axes, ((1.0, 4.0), (2.35, 2.6)), strict=True):
    axis.plot(time_s, felt_n, label="the foot feels")
    axis.step(time_s, force_n, where="post", label="footsense publishes, two sigma; gap: no force known")
    axis.fill_between(time_s, force_n - 2 * sigma_n, force_n + 2 * sigma_n, step="post", alpha=0.3)
    axis.set(xlim=(first_s, last_s), ylim=(-3, 12), xlabel="time [s]", ylabel="left front foot, z [N]")
axes[0].legend(loc="upper right")
figure.savefig(picture)
usable = np.mean([one.usable for one in told[100:]])
print(f"walked {data.qpos[0]:.2f} m; forces usable {usable:.1%} of the time")
