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

/// A place's share, with a sign, in a slot of a pair: the place is counted from the first one of the pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Share {
    pub(super) place: usize,
    pub(super) slot: usize,
    pub(super) sign: f64,
}

const fn share(place: usize, slot: usize, sign: f64) -> Share {
    Share { place, slot, sign }
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

    /// Places of the padded image that so many pairs cover.
    pub(super) fn covered(self, pairs: usize) -> usize {
        self.step() * pairs + if self == Self::Small { 0 } else { 1 }
    }

    /// The shares of a pair's places in its forms or products.
    pub(super) fn shares(self) -> &'static [Share] {
        const SMALL: [Share; 4] = [share(0, 0, 1.0), share(0, 1, 1.0), share(1, 1, 1.0), share(1, 2, 1.0)];
        const LARGE: [Share; 7] = [
            share(0, 0, 1.0),
            share(1, 1, 1.0),
            share(2, 0, -1.0),
            share(2, 2, 1.0),
            share(2, 4, -1.0),
            share(3, 3, 1.0),
            share(4, 4, 1.0),
        ];
        if self == Self::Small { &SMALL } else { &LARGE }
    }
}

/// The forms of the small image: `y₀`, `y₀ + y₁`, `y₁`.
const FORMS: usize = 3;
/// The products: `w₀y₀`, `w₁y₀`, `(w₀ + w₂)(y₀ + y₁)`, `w₁y₁`, `w₂y₁`.
const PARTS: usize = 5;
/// The form that each product takes.
pub(super) const FORM: [usize; PARTS] = [0, 0, 1, 2, 2];
/// The taps whose sum each product takes.
pub(super) const TAPS: [&[usize]; PARTS] = [&[0], &[1], &[0, 2], &[1], &[2]];

/// An axis and its pairs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Axis {
    pub(super) pairs: usize,
    small: usize,
    large: usize,
    padding: usize,
}

/// A product of a pair that a place of the large image is a sum of.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link {
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

    /// For each place of the large image, the products that it is the sum of.
    pub(super) fn links(&self) -> Vec<Vec<Link>> {
        let mut links = vec![Vec::new(); self.large];
        for pair in 0..self.pairs {
            for &Share { place, slot, sign } in Image::Large.shares() {
                let place = (Image::Large.step() * pair + place).checked_sub(self.padding);
                if let Some(links) = place.and_then(|place| links.get_mut(place)) {
                    links.push(Link { slot, pair, sign });
                }
            }
        }
        links
    }
}
