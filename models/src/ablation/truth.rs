//! The true material of a clip, if a file beside the clip states it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::identify::{FAMILIES, VELOCITY, law_of};
use crate::physics::{Law, Map, Parameter, law_file, name_of};
use crate::scenes::SceneFile;
use crate::text;
use crate::vector::{minus, norm};

/// The truth of a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Truth {
    /// Family of materials, or name of a law.
    pub family: String,
    /// The file of that law, if it is one's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub law: Option<PathBuf>,
    /// Parameters by name, in SI units.
    pub parameters: BTreeMap<String, f64>,
    /// Initial velocity \[m/s\], if it is known.
    pub velocity: Option<[f64; 3]>,
}

/// Alternative symbols of parameters; μ is a viscosity or a shear modulus.
const SYMBOLS: [(&str, &str); 6] = [
    ("E", "young"),
    ("nu", "poisson"),
    ("kappa", "bulk"),
    ("tau_Y", "yield_stress"),
    ("eta", "plastic_viscosity"),
    ("theta_fric", "friction_angle"),
];

impl Truth {
    /// Reads the truth of a clip folder: from `truth.json` in it, from the `scene.toml` of the simulation that rendered
    /// it into `clip/`, or from a JSON file beside it with its name. `None` if there is no such file, or it is invalid.
    pub fn beside(clip: &Path) -> Option<Self> {
        let clip = clip.canonicalize().ok()?;
        let text = |path: &Path| text::read(path, "what is known of the clip", "correct it", text::SETTINGS).ok();
        let json = |path: &Path| Self::of_json(&serde_json::from_str(&text(path)?).ok()?);
        json(&clip.join("truth.json"))
            .or_else(|| {
                let folder = clip.parent()?;
                Self::of_scene(&SceneFile::parse(&text(&folder.join("scene.toml"))?).ok()?, folder)
            })
            .or_else(|| json(&clip.with_extension("json")))
    }

    /// From `{"parameters": {name: number or {"value": number}}, "initial_velocity": …}`.
    fn of_json(truth: &Value) -> Option<Self> {
        let plain = |value: &Value| value.get("value").unwrap_or(value).clone();
        let given = truth["parameters"].as_object()?;
        let fluid = !given.contains_key("eta") && !given.contains_key("plastic_viscosity");
        let name = |symbol: &str| match (symbol, SYMBOLS.iter().find(|(known, _)| *known == symbol)) {
            (_, Some((_, name))) => (*name).to_owned(),
            ("mu", _) => if fluid { "viscosity" } else { "shear" }.to_owned(),
            _ => symbol.to_owned(),
        };
        let parameters: BTreeMap<String, f64> =
            given.iter().filter_map(|(symbol, value)| Some((name(symbol), plain(value).as_f64()?))).collect();
        let telling = [
            ("friction_angle", "sand"),
            ("plastic_viscosity", "non_newtonian"),
            ("yield_stress", "plasticine"),
            ("viscosity", "newtonian"),
            ("young", "elastic"),
        ];
        let family = telling.iter().find(|(parameter, _)| parameters.contains_key(*parameter))?.1.to_owned();
        let velocity = serde_json::from_value(plain(&truth["initial_velocity"])).ok();
        Some(Self { family, law: None, parameters, velocity })
    }

    /// From a scene with a single object, whose run in `folder` has kept a law of one's own.
    fn of_scene(scene: &SceneFile, folder: &Path) -> Option<Self> {
        let [object] = &scene.objects[..] else { return None };
        let stuff = scene.materials.get(&object.material)?;
        let own = stuff.law.ends_with(".wgsl").then(|| name_of(&stuff.law));
        let law = own.as_ref().map(|name| folder.join(law_file(name)));
        let known = FAMILIES.iter().find(|(_, law)| *law == stuff.law).map(|(family, _)| (*family).to_owned());
        let family = own.or(known).unwrap_or_else(|| stuff.law.clone());
        let (parameters, velocity) = (stuff.parameters.clone(), Some(object.velocity_m_s));
        Some(Self { family, law, parameters, velocity })
    }

    /// The law of the material.
    pub fn law(&self) -> Option<Law> {
        match &self.law {
            Some(file) => Law::read(file).ok(),
            None => law_of(&self.family),
        }
    }

    /// Initial values far from the truth: magnitudes alternately `factor` times below and above it, others at the more
    /// distant end of the plausible range; without those listed in `held`.
    pub fn off(&self, factor: f64, held: &[&str]) -> BTreeMap<String, f64> {
        let law = self.law();
        let searched = law.iter().flat_map(|law| law.parameters()).filter(|p| !held.contains(&p.name));
        let known = searched.filter_map(|p| Some((p, *self.parameters.get(p.name)?)));
        let mut far = 1.0 / factor;
        let start = |(p, truth): (&Parameter, f64)| {
            let [low, high] = p.prior;
            let start = match p.map {
                Map::Log10 => {
                    let start = truth * far;
                    far = 1.0 / far;
                    start
                }
                _ if truth - low > high - truth => low,
                _ => high,
            };
            (p.name.to_owned(), start)
        };
        known.map(start).collect()
    }

    /// The errors of estimates, by name: decades for magnitudes, the parameter's unit for others; `velocity` is the
    /// length of the difference relative to the true speed.
    pub fn errors(&self, estimates: &BTreeMap<String, f64>) -> BTreeMap<String, f64> {
        let mut errors = BTreeMap::new();
        for parameter in self.law().iter().flat_map(|law| law.parameters()) {
            if let (Some(found), Some(truth)) = (estimates.get(parameter.name), self.parameters.get(parameter.name)) {
                let off = if parameter.map == Map::Log10 { (found / truth).log10() } else { found - truth };
                // the logarithm is not finite for zero
                if off.is_finite() {
                    errors.insert(parameter.name.to_owned(), off);
                }
            }
        }
        let found = VELOCITY.map(|name| estimates.get(name).copied());
        if let ([Some(x), Some(y), Some(z)], Some(truth)) = (found, self.velocity)
            && norm(truth) > 0.0
        {
            errors.insert("velocity".into(), norm(minus([x, y, z], truth)) / norm(truth));
        }
        errors
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_form_is_understood() {
        let bird = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/clips/bird");
        let truth = Truth::beside(&bird).unwrap();
        assert_eq!((truth.family.as_str(), truth.parameters["young"]), ("elastic", 3e5));
        assert_eq!(truth.velocity, Some([-0.4, -0.6, 0.1]));
        let symbols = serde_json::json!({"parameters": {"mu": 1e4, "kappa": 1e6, "tau_Y": 3e3, "eta": 10.0}});
        let truth = Truth::of_json(&symbols).unwrap();
        assert_eq!((truth.family.as_str(), truth.parameters["shear"], truth.velocity), ("non_newtonian", 1e4, None));
        let off = truth.off(10.0, &["shear"]);
        assert_eq!((off["bulk"], off["yield_stress"], off.get("shear")), (1e5, 3e4, None));
        let scene = "[time]\nduration_s = 0.5\n[grid]\nspacing_m = 0.04\n[ground]\n[materials.m]\nlaw = 'newtonian'\n\
                     density_kg_m3 = 1e3\nviscosity = 50.0\nbulk = 1e5\n[[objects]]\nmaterial = 'm'\nvelocity_m_s = [0.0, -2.0, 0.0]\n\
                     shape.sphere = { centre_m = [0.0, 0.3, 0.0], radius_m = 0.1 }\n";
        let truth = Truth::of_scene(&SceneFile::parse(scene).unwrap(), Path::new("run")).unwrap();
        assert_eq!(truth.family, "newtonian");
        let own = scene.replace("newtonian", "laws/My law.wgsl");
        let truth_of_own = Truth::of_scene(&SceneFile::parse(&own).unwrap(), Path::new("run")).unwrap();
        assert_eq!((truth_of_own.family.as_str(), truth_of_own.law), ("my_law", Some("run/my_law.wgsl".into())));
        let found =
            [("viscosity", 500.0), ("bulk", 1e5), ("velocity_x", 0.0), ("velocity_y", -1.9), ("velocity_z", 0.0)];
        let errors = truth.errors(&found.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect());
        approx::assert_relative_eq!(errors["viscosity"], 1.0, max_relative = 1e-12);
        approx::assert_relative_eq!(errors["velocity"], 0.05, max_relative = 1e-12);
        assert_eq!(errors["bulk"], 0.0);
        assert!(Truth::beside(Path::new("nowhere")).is_none());
    }
}
