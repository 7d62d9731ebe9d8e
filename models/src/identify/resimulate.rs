//! A reconstructed object simulated again under other conditions.

use std::collections::BTreeMap;

use gradreel::{Error, ErrorKind, Result};

use crate::identify::config::no_such_parameter;
use crate::identify::{Reconstruction, Run, SPIN, VELOCITY};
use crate::report::quantity::compact;

/// What is to be different from what a run has found; what is left out stays.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Changes {
    /// Parameters of the material by name, in SI units.
    pub parameters: BTreeMap<String, f64>,
    /// Initial velocity \[m/s\].
    pub velocity: Option<[f64; 3]>,
    /// Initial spin \[rad/s\].
    pub spin: Option<[f64; 3]>,
    /// Gravity \[m/s²\].
    pub gravity: Option<[f64; 3]>,
    /// Height of the ground \[m\].
    pub ground: Option<f64>,
}

impl Changes {
    /// Makes the changes to what a run has found and to the world in its configuration; says each in words.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a parameter that the material does not have, or a value that it or the world cannot take.
    /// Nothing is changed then.
    pub fn apply(&self, found: &mut Reconstruction, run: &mut Run) -> Result<Vec<String>> {
        let parameters = found.law.parameters();
        let mut unknowns = found.unknowns.clone();
        let mut config = run.config.clone();
        let mut words = Vec::new();
        for (name, &value) in &self.parameters {
            let Some(at) = parameters.iter().position(|p| p.name == name) else {
                return Err(no_such_parameter(&found.law, name, "--set"));
            };
            let p = &parameters[at];
            if !p.map.raw(value).is_finite() {
                return Err(Error::new(ErrorKind::Input, format!("the parameter {name} cannot have this value"))
                    .at("--set")
                    .found(format!("{} {}", compact(value), p.unit))
                    .fix(format!("give for example {} {}", p.start, p.unit)));
            }
            words.push(format!("{} {:.4e} {} instead of {:.4e}", p.symbol, value, p.unit, unknowns.parameters[at]));
            unknowns.parameters[at] = value;
        }
        if let Some(velocity) = self.velocity {
            finite("--velocity", velocity)?;
            words.push(format!("v {velocity:?} m/s instead of {:.3?}", unknowns.velocity));
            unknowns.velocity = velocity;
        }
        if let Some(spin) = self.spin {
            finite("--spin", spin)?;
            words.push(format!("ω {spin:?} rad/s instead of {:.3?}", unknowns.spin));
            (unknowns.spin, config.estimate.spin) = (spin, true);
        }
        if let Some(gravity) = self.gravity {
            words.push(format!("g {gravity:?} m/s² instead of {:?}", config.world.gravity));
            config.world.gravity = gravity;
        }
        if let Some(ground) = self.ground {
            words.push(format!("ground at {ground} m instead of {}", config.world.ground));
            config.world.ground = ground;
        }
        config.check()?;
        run.config = config;
        run.state.unknowns = Some(unknowns.clone());
        found.unknowns = unknowns;
        found.given = self.parameters.keys().cloned().collect();
        if self.velocity.is_some() {
            found.given.extend(VELOCITY.map(str::to_owned));
        }
        if self.spin.is_some() {
            found.given.extend(SPIN.map(str::to_owned));
        }
        found.changes.clone_from(&words);
        Ok(words)
    }
}

/// Refuses values of an option that are not finite.
fn finite(option: &str, values: [f64; 3]) -> Result<()> {
    match values.iter().all(|value| value.is_finite()) {
        true => Ok(()),
        false => {
            Err(Error::new(ErrorKind::Input, format!("the {} is not finite", option.trim_start_matches('-')))
                .at(option))
        }
    }
}
