//! Free flights between hits, and what they tell of the hits.

use serde::{Deserialize, Serialize};

use super::story::Sight;
use crate::physics::NINETY;

/// A free flight of an object in the picture.
#[derive(Debug, Clone, PartialEq)]
pub struct FreeFlight {
    /// Where the object was seen, in the order of time \[pixels\].
    pub sights: Vec<Sight>,
    /// Standard deviation of these places \[pixels\].
    pub scatter: f64,
    /// Whether a hit joins it to the next flight.
    pub bounces: bool,
}

/// A number with its standard deviation.
///
/// ```
/// use gradreel_models::video::Known;
///
/// let [low, high] = Known { value: 0.8, deviation: 0.02 }.interval_90();
/// assert!((low - 0.7671).abs() < 1e-4 && (high - 0.8329).abs() < 1e-4);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Known {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub deviation: f64,
}

impl Known {
    /// Ends of the interval that holds it with a probability of 90 %.
    pub fn interval_90(&self) -> [f64; 2] {
        [-NINETY, NINETY].map(|z| self.value + z * self.deviation)
    }
}

/// One hit between two free flights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Hit {
    /// Its time in the film \[s\].
    pub seconds: f64,
    /// Speed towards the ground just before it \[m/s\].
    pub speed: f64,
    /// Speed away from the ground after it as a share of that towards it before.
    pub restitution: Known,
    /// Velocity along the ground after it as a share of that before; `None` where it hardly moved along.
    pub tangential: Option<Known>,
}

/// What the free flights of a film tell of its hits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bounces {
    /// The contact lasts at most so long \[s\], as no picture shows it.
    pub contact: f64,
    /// Number of flights that were fitted together.
    pub flights: usize,
    /// The hits between them.
    pub hits: Vec<Hit>,
    /// Restitution of another such hit: the mean of all, with their scatter.
    pub restitution: Known,
    /// The same of the velocity along the ground.
    pub tangential: Option<Known>,
    /// Velocity in the clip's first frame: to the right, up, and towards the camera \[m/s\].
    pub velocity: [Known; 3],
    /// Displacement of the object since the clip's first frame in each of its frames \[m\].
    pub path: Vec<[f64; 3]>,
}

/// Pictures of a contact from which on its simulation tells something.
const PICTURES: f64 = 4.0;

/// Frame rates that cameras offer \[1/s\].
const RATES: [f64; 9] = [60.0, 120.0, 240.0, 480.0, 960.0, 2000.0, 5000.0, 10_000.0, 20_000.0];

impl Bounces {
    /// The least frame rate of a film that could show the contact in four pictures \[1/s\].
    pub fn rate_wanted(&self) -> f64 {
        let least = PICTURES / self.contact;
        RATES.into_iter().find(|rate| *rate >= 0.97 * least).unwrap_or(least)
    }

    /// What is found, in one line.
    pub fn said(&self) -> String {
        let [low, high] = self.restitution.interval_90();
        format!(
            "contact: shorter than a frame (at most {}); restitution {:.2} ({low:.2} to {high:.2}) by {} hits; stiffness cannot be seen",
            self.room(),
            self.restitution.value,
            self.hits.len()
        )
    }

    /// Why the material's own parameters are not determined, and how they could be.
    pub fn why(&self) -> String {
        format!(
            "the contact lasts at most {} and no picture shows it, so that the stiffness cannot be seen; film with at least {:.0} \
             frames a second, or simulate it nevertheless with --contact resolved",
            self.room(),
            self.rate_wanted()
        )
    }

    /// The longest contact in milliseconds.
    fn room(&self) -> String {
        format!("{:.0} ms", 1e3 * self.contact)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_that_would_show_a_contact() {
        let restitution = Known { value: 0.87, deviation: 0.02 };
        let at = |contact| Bounces {
            contact,
            flights: 2,
            hits: vec![],
            restitution,
            tangential: None,
            velocity: [Known { value: 0.0, deviation: 0.1 }; 3],
            path: vec![],
        };
        assert_eq!([1.0 / 60.0, 0.1, 1e-3].map(|contact| at(contact).rate_wanted()), [240.0, 60.0, 5000.0]);
        let said = at(1.0 / 60.0).said();
        assert!(
            said.contains("shorter than a frame (at most 17 ms)") && said.contains("0.87 (0.84 to 0.90)"),
            "{said}"
        );
        assert!(at(1.0 / 60.0).why().contains("240"));
    }
}
