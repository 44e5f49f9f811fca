"""Guaranteed pose sets: all poses that show the dots in their boxes of pixels, enclosed by proof."""

from cpcal.vision.pose_sets.pixel_boxes import PixelBoxes
from cpcal.vision.pose_sets.pose_set import PoseSet, enclose_pose
from cpcal.vision.pose_sets.set_campaign import campaign_of
from cpcal.vision.pose_sets.uncertain import CameraSet, TargetSet

__all__ = ["CameraSet", "PixelBoxes", "PoseSet", "TargetSet", "campaign_of", "enclose_pose"]
