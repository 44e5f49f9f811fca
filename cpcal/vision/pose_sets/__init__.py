"""Guaranteed pose sets: all poses that show the dots in their boxes of pixels, enclosed by proof."""

from cpcal.vision.pose_sets.pose_set import PoseSet, campaign_of, enclose_pose
from cpcal.vision.pose_sets.sight import PixelBoxes
from cpcal.vision.pose_sets.uncertain import CameraSet, TargetSet

__all__ = ["CameraSet", "PixelBoxes", "PoseSet", "TargetSet", "campaign_of", "enclose_pose"]
