//! Small pictures of a film in time order.

/// Red, green and blue.
pub(in crate::video::film) type Rgb = [u8; 3];

/// Small pictures of equal size with their numbers in the film and their times.
pub(in crate::video::film) struct Sequence {
    pub width: usize,
    pub height: usize,
    /// Number of each picture in the film.
    pub numbers: Vec<usize>,
    /// Time of each picture \[s\].
    pub times: Vec<f64>,
    pub pictures: Vec<Vec<Rgb>>,
}
