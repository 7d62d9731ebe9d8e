//! Optimisers against PyTorch, against closed forms, and against themselves after a pause.

mod first_order;
mod least_squares;
mod params;
mod resume;
