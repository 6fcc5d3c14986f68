//! Triangle meshes as PLY files.

use crate::atomic_file;
use crate::error::Result;
use glam::DVec3;
use std::path::Path;

/// Writes triangles, each with corners of its own, in binary PLY with `f32` coordinates.
///
/// # Errors
/// [`Error::Io`](crate::error::Error::Io) when the file cannot be written.
pub fn write(path: &Path, triangles: &[[DVec3; 3]]) -> Result<()> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        3 * triangles.len(),
        triangles.len()
    )
    .into_bytes();
    for v in triangles.iter().flatten() {
        v.as_vec3().to_array().iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    }
    for face in 0..triangles.len() as u32 {
        bytes.push(3);
        (0..3).for_each(|k| bytes.extend((3 * face + k).to_le_bytes()));
    }
    atomic_file::write(path, &bytes)
}
