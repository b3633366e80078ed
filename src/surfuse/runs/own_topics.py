"""The topics that replay and resume read, in the order in which every segment registers them.

The order is part of the format: when the chunk that holds the definitions is damaged, channel numbers 1, 2, ...
still say which topic a message belongs to.
"""

from __future__ import annotations

from surfuse.runs import definitions as msg

SCENE_TOPIC = "/surfuse/scene"
SWEEP_TOPIC = "/surfuse/sweep"
PLAN_TOPIC = "/surfuse/plan"
VIEW_TOPIC = "/surfuse/camera_view"
EVENT_TOPIC = "/surfuse/event"

OWN_TOPICS: tuple[tuple[str, msg.Definition], ...] = (
    (SCENE_TOPIC, msg.SCENE),
    (SWEEP_TOPIC, msg.SWEEP),
    (PLAN_TOPIC, msg.PLAN),
    (VIEW_TOPIC, msg.VIEW),
    (EVENT_TOPIC, msg.EVENT),
)
