"""A small test hand with all features of SDF frames and joints, as SDF and YAML texts."""

from __future__ import annotations

from typing import Any

INERTIAL = (
    "<inertial><pose>0.01 0 0 0 0 0.3</pose><mass>0.2</mass><inertia><ixx>2e-4</ixx><iyy>3e-4</iyy>"
    "<izz>2.5e-4</izz><ixy>1e-5</ixy><ixz>0</ixz><iyz>-2e-5</iyz></inertia></inertial>"
)
LIMIT = "<limit><lower>-0.5</lower><upper>1.2</upper><effort>3</effort></limit>"
# Poses of every kind that SDF has: in the model, relative to links, joints and frames, in degrees,
# joints beside their link's origin, axes in other frames, and a coupled joint.
SDF = f"""<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="claw">
  <link name="palm">{INERTIAL}<collision name="c"><pose>0 0 0.01 0.1 0 0</pose>
    <geometry><box><size>0.06 0.05 0.04</size></box></geometry></collision></link>
  <frame name="knuckle" attached_to="palm"><pose>0.02 0.01 0.03 0.2 -0.1 0.4</pose></frame>
  <link name="finger"><pose relative_to="knuckle">0.01 0 0 0 0.3 0</pose>{INERTIAL}
    <collision name="c"><geometry><capsule><radius>0.008</radius><length>0.05</length></capsule>
    </geometry></collision></link>
  <joint name="bend" type="revolute"><pose>0 0.002 -0.02 0.1 0 0</pose>
    <parent>palm</parent><child>finger</child>
    <axis><xyz expressed_in="knuckle">0 1 0.2</xyz>{LIMIT}</axis></joint>
  <link name="tip"><pose degrees="true" relative_to="bend">0 0 0.06 0 30 0</pose>{INERTIAL}
    <collision name="c"><geometry><sphere><radius>0.009</radius></sphere></geometry></collision>
  </link>
  <joint name="curl" type="revolute"><parent>finger</parent><child>tip</child>
    <axis><xyz>0 1 0</xyz>{LIMIT}</axis>
    <drake:mimic joint="bend" multiplier="0.5" offset="0.1"/></joint>
  <link name="thumb"><pose>-0.03 0 0.02 0 0 0</pose>{INERTIAL}
    <collision name="c"><pose>0 0 0.03 0 0 0</pose><geometry><cylinder><radius>0.007</radius>
    <length>0.06</length></cylinder></geometry></collision></link>
  <joint name="slide" type="prismatic"><pose relative_to="palm">-0.02 0 0 0 0 0.5</pose>
    <parent>palm</parent><child>thumb</child>
    <axis><xyz>1 0 0</xyz>{LIMIT}</axis></joint>
  <link name="plate"><pose relative_to="thumb">0 0 0.06 0 0 0</pose></link>
  <joint name="mount" type="fixed"><parent>thumb</parent><child>plate</child></joint>
</model></sdf>
"""
YAML: dict[str, Any] = {
    "name": "claw",
    "kind": "multi_finger",
    "urdf": "claw.sdf",
    "joints": ["bend", "slide"],
    "palm_frame": {"translation": [0, 0, 0.03], "rpy": [0, 0, 0]},
    "approach": [0, 0, 1],
    "max_contact_force": 5,
    "pads": {
        name: {"link": link, "center": [0, 0, 0], "radius": 0.009, "axis": a, "half_angle": 1}
        for name, link, a in (("finger", "tip", [-1, 0, 0]), ("thumb", "plate", [1, 0, 0]))
    },
    "pregrasps": {"wide": [0.1, 0.1]},
    "probe_postures": {
        "finger": {
            "positions": [0, 0],
            "direction": [0, 0, 1],
            "tip": {"link": "tip", "center": [0, 0, 0], "radius": 0.009},
        }
    },
    "self_collision_exclusions": [],
}
