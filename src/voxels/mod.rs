//! Spatial subdivision into unequal voxels and the spatial index SI (section 4.1).
