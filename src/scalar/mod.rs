//! Scalar programs: write a pointwise function once, differentiate it, run it anywhere.
