//! Video: frames, masks and cameras of a clip.
