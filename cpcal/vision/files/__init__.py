"""What vision reads and writes: targets, cameras, images, tables of poses and of leg readings."""
