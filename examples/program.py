"""LiveHand from a program: a fist of Maya's turns in the light of one lamp; writes FOLDER/0.png, ...

python examples/program.py FOLDER [--size 512] [--frames 4]
"""

import argparse
from pathlib import Path

import numpy as np
from livehand import api
from PIL import Image

parser = argparse.ArgumentParser()
parser.add_argument("folder", type=Path)
parser.add_argument("--size", type=int, default=512)
parser.add_argument("--frames", type=int, default=4)
args = parser.parse_args()
person = api.load_person("middle")
towards_lamp = np.array([-2.0, -2.0, 1.0]) / 3
lamp = api.Lamp("sun", np.array([3.0, 2.8, 2.5]), rotation=api.rotation_facing(towards_lamp))
light = api.Light((lamp,), api.Sky(np.full((2, 4, 3), 0.2)))
camera = person.camera(api.named_pose("Fist"), (args.size, args.size))
args.folder.mkdir(parents=True, exist_ok=True)
for number, angle in enumerate(np.linspace(-0.6, 0.6, args.frames)):
    pose = api.named_pose("Fist", wrist=np.array([0, 0, angle]))
    frame = person.render(pose, camera, light)
    Image.fromarray(api.srgb_pixels(frame)).save(args.folder / f"{number}.png")
