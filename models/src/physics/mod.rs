//! Physics: the differentiable material point method.
