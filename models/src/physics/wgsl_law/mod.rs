//! Laws written in WGSL: parsed and validated, then lowered to scalar programs like any other law.
//!
//! ```text
//! my.wgsl ──source──▶ text with the prelude ──module──▶ naga's IR ──declare──▶ parameters, history, functions
//!                                                                  └──machine──▶ symbolic values ──▶ Material ──▶ Law
//! ```

mod arithmetic;
mod builtins;
mod comment;
mod declare;
mod exit;
mod expression;
mod fault;
mod intrinsics;
mod lexer;
mod machine;
mod module;
mod source;
#[cfg(test)]
mod tests;
mod value;

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use gradreel::scalar::{Mat3, Program, Scalar};
use gradreel::{Error, Result};

use self::declare::{Declared, Entry, Layout, Role};
use self::machine::{Machine, Variables};
use self::module::Parsed;
use self::value::Value;
use super::law::SOMEWHERE;
use super::material::{Given, History, Material, Point};
use super::parameters::Parameter;
use super::sound;

/// A law from a file in WGSL.
///
/// The file declares `struct Parameters`, whose members carry unit, map and prior in `///` comments, and functions: `stress`,
/// and if needed `return_map`, `struct History` with `evolve`, and `wave_speed`. They are those of [`Material`]. A prelude
/// declares `Point` (`f`, `previous`, `c`, `dt`) and functions on matrices; see the guide *laws*.
///
/// ```
/// use gradreel_models::physics::{Law, WgslLaw};
///
/// let law = WgslLaw::parse(
///     "foam.wgsl",
///     "struct Parameters {
///         /// Bulk modulus K [Pa], log10, 1e3 to 1e6
///         bulk: f32,
///     }
///     fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
///         return p.bulk * (trace(point.f) - 3.0) * identity();
///     }",
/// )?;
/// assert_eq!(Law::of(law).name(), "foam");
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct WgslLaw(Arc<Body>);

#[derive(Debug)]
struct Body {
    name: String,
    parsed: Parsed,
    declared: Declared,
    /// `parameters, density ↦ c`
    wave_speed: Option<Program>,
    /// `place ↦ history`
    rest: Option<Program>,
    survives_inversion: bool,
}

impl WgslLaw {
    /// Reads a file.
    ///
    /// # Errors
    ///
    /// Those of [`WgslLaw::parse`], and of reading.
    pub fn read(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let reading = |error: std::io::Error| {
            Error::io(path, "read the law", &error)
                .fix("give a file in WGSL; docs/guide/laws.md shows how to write one")
        };
        let (mut text, most) = (String::new(), source::MOST_BYTES as u64);
        // one byte more is too many, and enough to say so
        File::open(path).and_then(|file| file.take(most + 1).read_to_string(&mut text)).map_err(reading)?;
        Self::parse(&path.display().to_string(), &text)
    }

    /// Reads a text; `path` names it in errors, and its stem is the name of the law.
    ///
    /// # Errors
    ///
    /// [`ErrorKind::Input`](gradreel::ErrorKind::Input) with line, column and fix: for text that is not valid WGSL; for what
    /// has no form as a scalar program (textures, `discard`, integers that depend on a particle, loops without a constant
    /// bound); for parameters without a comment of the documented form; beyond 256 KiB or 10 000 operations.
    pub fn parse(path: &str, text: &str) -> Result<Self> {
        let parsed = Parsed::new(path, text)?;
        let declared = Declared::new(&parsed)?;
        let mut body =
            Body { name: name_of(path), parsed, declared, wave_speed: None, rest: None, survives_inversion: true };
        body.rest = body.start()?;
        if let Some(rest) = &body.rest {
            let start = rest.eval(&SOMEWHERE);
            body.declared.history.iter_mut().zip(start).for_each(|(variable, start)| variable.start = start);
        }
        body.survives_inversion = body.check()?;
        body.wave_speed = body.speed()?;
        Ok(Self(Arc::new(body)))
    }
}

/// The name of the copy of a law in the folder of a run.
pub(crate) fn law_file(law: &str) -> String {
    format!("{law}.wgsl")
}

/// The name of the law in a file: the stem of its path as an identifier.
pub(crate) fn name_of(path: &str) -> String {
    let stem = Path::new(path).file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    let name: String =
        stem.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' }).collect();
    let name = name.trim_matches('_');
    // `auto` stands for a choice among families
    if name.starts_with(|c: char| c.is_ascii_alphabetic()) && name != "auto" {
        name.to_owned()
    } else {
        format!("law_{name}")
    }
}

impl Body {
    /// Runs every function once; whether the stress is finite for inverted material.
    fn check(&self) -> Result<bool> {
        let (parameters, history) = (&self.declared.parameters, &self.declared.history);
        let fixed = ["f", "p", "c"].iter().flat_map(|part| (0..9).map(move |k| format!("{part}_{k}")));
        let named =
            parameters.iter().map(|p| format!("in_{}", p.name)).chain(history.iter().map(|h| format!("h_{}", h.name)));
        let inputs: Vec<String> = fixed.chain(["substep".to_owned()]).chain(named).collect();
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        let outputs: Vec<String> = (0..9).map(|k| format!("tau_{k}")).collect();
        let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
        let mut outcome = Ok(());
        let stress = Program::trace("stress", &inputs, &outputs, |x| {
            let matrix = |at: usize| Mat3::from_slice(&x[at..at + 9]);
            let point = Point { f: matrix(0), previous: matrix(9), c: matrix(18) };
            let given = Given {
                values: parameters.iter().map(|p| p.name).zip(x[28..].iter().copied()).collect(),
                history: history.iter().map(|h| h.name).zip(x[28 + parameters.len()..].iter().copied()).collect(),
                dt: x[27],
            };
            self.respond(point, given).map_or_else(
                |error| {
                    outcome = Err(error);
                    Mat3::zero().to_vec()
                },
                Mat3::to_vec,
            )
        });
        outcome?;
        let inverted = [[1.0, 1.0, -0.9], [-1.0, -1.0, -1.0], [1.2, -0.4, 0.9], [1.0, 1.0, -1.0]];
        let finite = |[a, b, c]: [f64; 3]| {
            let f = [a, 0.0, 0.0, 0.0, b, 0.0, 0.0, 0.0, c];
            let values = parameters.iter().map(|p| p.start).chain(history.iter().map(|h| h.start));
            let inputs: Vec<f64> = f.into_iter().chain(f).chain([0.0; 9]).chain([1e-4]).chain(values).collect();
            stress.eval(&inputs).iter().all(|y| y.is_finite())
        };
        Ok(inverted.into_iter().all(finite))
    }

    /// The stress of a trial deformation, from what all functions return.
    fn respond(&self, point: Point, mut given: Given) -> Result<Mat3> {
        let f = match &self.declared.return_map {
            Some(entry) => self.matrix(&self.run(entry, &point, &given)?)?,
            None => point.f,
        };
        if let Some(entry) = &self.declared.evolve {
            let new = self.entries(entry, &self.run(entry, &point, &given)?)?;
            given.history.iter_mut().zip(new).for_each(|((_, old), new)| *old = new);
        }
        self.matrix(&self.run(&self.declared.stress, &Point { f, ..point }, &given)?)
    }

    /// The program of `wave_speed`.
    fn speed(&self) -> Result<Option<Program>> {
        let Some(entry) = &self.declared.wave_speed else { return Ok(None) };
        let parameters = &self.declared.parameters;
        let names: Vec<&str> = parameters.iter().map(|p| p.name).chain(["density"]).collect();
        let mut outcome = Ok(());
        let program = Program::trace("wave_speed", &names, &["c"], |x| {
            let arguments = entry.roles.iter().map(|role| match role {
                Role::Density => Value::Number(x[parameters.len()]),
                _ => Value::many(x[..parameters.len()].iter().map(|&x| Value::Number(x))),
            });
            let found = self.call(entry, arguments.collect());
            let speed = found.and_then(|value| value.number().ok_or_else(|| self.broken(entry)));
            vec![speed.unwrap_or_else(|error| {
                outcome = Err(error);
                0.0.into()
            })]
        });
        outcome.map(|()| Some(program))
    }

    /// The program of `rest`.
    fn start(&self) -> Result<Option<Program>> {
        let Some(entry) = &self.declared.rest else { return Ok(None) };
        let names: Vec<&str> = self.declared.history.iter().map(|variable| variable.name).collect();
        let mut outcome = Ok(());
        let program = Program::trace("rest", &["place_x", "place_y", "place_z"], &names, |x| {
            let place = Value::many(x.iter().map(|&x| Value::Number(x)));
            let found = self.call(entry, vec![place]).and_then(|value| self.entries(entry, &value));
            found.unwrap_or_else(|error| {
                outcome = Err(error);
                vec![0.0.into(); names.len()]
            })
        });
        outcome.map(|()| Some(program))
    }

    /// The numbers of a `History` that a function returned.
    fn entries(&self, entry: &Entry, history: &Value) -> Result<Vec<Scalar>> {
        let members: Option<Vec<Vec<Scalar>>> = history.parts().iter().map(Value::flat).collect();
        members.map(|members| members.concat()).ok_or_else(|| self.broken(entry))
    }

    fn run(&self, entry: &Entry, point: &Point, given: &Given) -> Result<Value> {
        let arguments = entry.roles.iter().map(|role| match role {
            Role::Point => Value::many([point.f.into(), point.previous.into(), point.c.into(), given.dt.into()]),
            Role::Parameters => Value::many(self.declared.parameters.iter().map(|p| Value::Number(given[p.name]))),
            Role::History => self.remembered(given),
            Role::Density | Role::Place => Value::Unknown,
        });
        self.call(entry, arguments.collect())
    }

    fn call(&self, entry: &Entry, arguments: Vec<Value>) -> Result<Value> {
        let span = self.parsed.module.functions.get_span(entry.function);
        let mut machine = Machine::new(&self.parsed);
        let called = machine.call(entry.function, arguments, Variables::default(), span);
        let (_, value) = called.map_err(|fault| self.parsed.source.error(*machine.placed(fault)))?;
        value.ok_or_else(|| self.broken(entry))
    }

    /// The members of `History` from their entries.
    fn remembered(&self, given: &Given) -> Value {
        let mut entries = self.declared.history.iter().map(|one| given[one.name]);
        let members = self.declared.layout.iter().map(|layout| {
            let numbers: Vec<Scalar> = entries.by_ref().take(layout.len()).collect();
            match layout {
                Layout::Number => numbers[0].into(),
                Layout::Vector(_) => Value::many(numbers.into_iter().map(Value::Number)),
                Layout::Matrix => Mat3::from_slice(&numbers).into(),
            }
        });
        Value::many(members.collect::<Vec<_>>())
    }

    fn matrix(&self, value: &Value) -> Result<Mat3> {
        value.mat3().ok_or_else(|| self.broken(&self.declared.stress))
    }

    /// A function without the value that its type promises, which validation excludes.
    fn broken(&self, entry: &Entry) -> Error {
        let span = self.parsed.module.functions.get_span(entry.function);
        self.parsed.source.error(*fault::Fault::new(span, "this function has no value that is known"))
    }
}

/// Every function has been run with symbolic numbers when the law was read; numbers that are known only leave code out.
const CHECKED: &str = "the law was run when it was read";

impl Material for WgslLaw {
    fn name(&self) -> &str {
        &self.0.name
    }

    fn parameters(&self) -> Vec<Parameter> {
        self.0.declared.parameters.clone()
    }

    fn history(&self) -> Vec<History> {
        self.0.declared.history.clone()
    }

    fn return_map(&self, trial: &Point, given: &Given) -> Option<Mat3> {
        let entry = self.0.declared.return_map.as_ref()?;
        Some(self.0.run(entry, trial, given).and_then(|value| self.0.matrix(&value)).expect(CHECKED))
    }

    fn evolve(&self, trial: &Point, given: &Given) -> Vec<Scalar> {
        let Some(entry) = &self.0.declared.evolve else {
            return given.history.iter().map(|(_, value)| *value).collect();
        };
        self.0.run(entry, trial, given).and_then(|value| self.0.entries(entry, &value)).expect(CHECKED)
    }

    fn rest(&self, place: [f64; 3]) -> Option<Vec<f64>> {
        self.0.rest.as_ref().map(|rest| rest.eval(&place))
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        self.0.run(&self.0.declared.stress, point, given).and_then(|value| self.0.matrix(&value)).expect(CHECKED)
    }

    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        match &self.0.wave_speed {
            Some(program) => program.eval(&[values, &[density]].concat())[0],
            None => sound::fastest(self, values, density),
        }
    }

    fn text(&self) -> Option<&str> {
        Some(&self.0.parsed.source.user)
    }

    fn survives_inversion(&self) -> bool {
        self.0.survives_inversion
    }
}
