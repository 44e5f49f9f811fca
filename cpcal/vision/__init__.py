"""From images to poses: target, camera, rendering, dots, identification, pose (the paper, section 2.3).

Frames. Pixels: x right, y down, the centre of the top-left pixel is (0, 0). Camera: x right, y down, z forward, mm.
Target: x to the right and y up as printed, z out of the plate towards the viewer, mm; the dots lie in z = 0.
"""
