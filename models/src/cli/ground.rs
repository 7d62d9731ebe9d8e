//! Options that say where the ground is, and how finely the object is divided.

use gradreel::Result;

use crate::cli::unit::number_in;
use crate::identify::{Config, GroundContact};

/// What the command line says of the ground and the grid.
#[derive(clap::Args)]
pub(super) struct GroundArguments {
    /// Height of the ground [m]; auto takes it to be where the object lands [default: 0; of a film, where the fall ends]
    #[arg(long, value_name = "M|auto", value_parser = height, allow_negative_numbers = true)]
    ground: Option<Height>,
    /// What the ground does to what touches it: sticky holds it, slip lets it slide, friction slows it down (its coefficient is found)
    /// and lets it leave; auto tries each [default: sticky]
    #[arg(long, value_name = "KIND", value_enum, hide_possible_values = true)]
    ground_contact: Option<GroundContact>,
    /// Grid spacing of the simulation [m] [default: 0.02, or one that gives about ten thousand particles]
    #[arg(long, value_name = "M", value_parser = |text: &str| number_in(text, "m"))]
    #[arg(allow_negative_numbers = true)]
    dx: Option<f64>,
}

impl GroundArguments {
    /// Whether any option was given.
    pub fn are_given(&self) -> bool {
        self.ground.is_some() || self.ground_contact.is_some() || self.dx.is_some()
    }

    /// Overrides the settings with the given options.
    pub fn apply(&self, config: &mut Config) {
        match self.ground {
            Some(Height::Given(height)) => (config.world.ground, config.world.find_ground) = (height, false),
            Some(Height::Found) => config.world.find_ground = true,
            None => {}
        }
        config.world.ground_contact = self.ground_contact.unwrap_or(config.world.ground_contact);
        config.geometry.dx = self.dx.unwrap_or(config.geometry.dx);
    }
}

/// Source of the ground height \[m\].
#[derive(Debug, Clone, Copy, PartialEq)]
enum Height {
    Given(f64),
    Found,
}

fn height(text: &str) -> Result<Height, String> {
    match text {
        "auto" => Ok(Height::Found),
        number => {
            number_in(number, "m").map(Height::Given).map_err(|e| format!("neither `auto` nor a height in metres: {e}"))
        }
    }
}
