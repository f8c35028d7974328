"""Files that scenes read: the meshes of configs/meshes and the table of configs/tables."""
