//! Pairs of places along one axis, and what their five products need and give.
//!
//! With stride 2, a kernel `w₀ w₁ w₂` links places `y` of the small image to places `x = 2y, 2y + 1, 2y + 2` of the padded large
//! one. Two neighbours `y₀ y₁` reach five places:
//!
//! ```text
//! x₀ = w₀y₀        x₁ = w₁y₀        x₂ = w₂y₀ + w₀y₁        x₃ = w₁y₁        x₄ = w₂y₁
//! ```
//!
//! of which `x₂` costs one product, `(w₀ + w₂)(y₀ + y₁) − x₀ − x₄`: five products instead of six. `x₄` of one pair and `x₀` of
//! the next one are the same place.

/// Which of the two images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Image {
    Small,
    Large,
}

impl Image {
    /// Forms of the small image, or products that make the large one.
    pub(super) fn slots(self) -> usize {
        if self == Self::Small { FORMS } else { PARTS }
    }

    /// Places of the padded image from one pair to the next.
    pub(super) fn step(self) -> usize {
        if self == Self::Small { 2 } else { 4 }
    }
}

/// The forms of the small image: `y₀`, `y₀ + y₁`, `y₁`.
pub(super) const FORMS: usize = 3;
/// The products: `w₀y₀`, `w₁y₀`, `(w₀ + w₂)(y₀ + y₁)`, `w₁y₁`, `w₂y₁`.
pub(super) const PARTS: usize = 5;
/// The form that each product takes.
pub(super) const FORM: [usize; PARTS] = [0, 0, 1, 2, 2];
/// The taps whose sum each product takes.
pub(super) const TAPS: [&[usize]; PARTS] = [&[0], &[1], &[0, 2], &[1], &[2]];

/// Place `step · pair + offset` of the padded image has a share, with a sign, in a form or a product.
const SMALL: [(usize, usize, f64); 4] = [(0, 0, 1.0), (0, 1, 1.0), (1, 1, 1.0), (1, 2, 1.0)];
const LARGE: [(usize, usize, f64); 7] =
    [(0, 0, 1.0), (1, 1, 1.0), (2, 0, -1.0), (2, 2, 1.0), (2, 4, -1.0), (3, 3, 1.0), (4, 4, 1.0)];

/// An axis and its pairs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) pairs: usize,
    small: usize,
    large: usize,
    padding: usize,
}

/// A share of an image's place in a form, or in a product, of a pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
    pub(super) place: usize,
    pub(super) slot: usize,
    pub(super) pair: usize,
    pub(super) sign: f64,
}

impl Axis {
    /// An axis of so many places of the small and of the large image.
    pub(super) fn new([small, large]: [usize; 2], padding: usize) -> Self {
        Self { pairs: small.div_ceil(2), small, large, padding }
    }

    /// Places of an image.
    pub(super) fn places(&self, image: Image) -> usize {
        if image == Image::Small { self.small } else { self.large }
    }

    /// The zeros in front of an image.
    pub(super) fn before(&self, image: Image) -> usize {
        if image == Image::Small { 0 } else { self.padding }
    }

    /// All shares of an image's places.
    pub(super) fn links(&self, image: Image) -> impl Iterator<Item = Link> + use<> {
        let shares: &[_] = if image == Image::Small { &SMALL } else { &LARGE };
        let (step, before, places) = (image.step(), self.before(image), self.places(image));
        (0..self.pairs).flat_map(move |pair| {
            shares.iter().filter_map(move |&(offset, slot, sign)| {
                let place = (step * pair + offset).checked_sub(before).filter(|&place| place < places)?;
                Some(Link { place, slot, pair, sign })
            })
        })
    }
}
