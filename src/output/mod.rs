//! Images to files.
