//! One camera: free fall as the measure of distance, and films of all kinds.

mod around;
mod ball;
mod bad_films;
mod fall;
mod films;
mod kinds;
mod times;
