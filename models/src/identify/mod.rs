//! Identify: geometry, velocity and material, each by gradients from the pixels.
