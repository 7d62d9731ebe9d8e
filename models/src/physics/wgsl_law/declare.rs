//! What a file declares: parameters, history, and the functions of the law.

use std::ops::Range;

use gradreel::Result;
use naga::{Function, Handle, ScalarKind, Type, TypeInner};

use super::comment::{self, FORM, HISTORY_FORM, Start};
use super::fault::Fault;
use super::lexer::{Kind, tokens};
use super::module::Parsed;
use crate::physics::law::{HISTORY_LIMIT, PARAMETER_LIMIT};
use crate::physics::material::History;
use crate::physics::names::name;
use crate::physics::parameters::{Map, Parameter};

/// What an argument of a function of the law is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Point,
    Parameters,
    History,
    Density,
    Place,
}

/// A function of the law.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub function: Handle<Function>,
    pub roles: Vec<Role>,
}

/// How the entries of a member of `History` are laid out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    Number,
    Vector(usize),
    Matrix,
}

impl Layout {
    pub fn len(self) -> usize {
        match self {
            Self::Number => 1,
            Self::Vector(count) => count,
            Self::Matrix => 9,
        }
    }
}

#[derive(Debug)]
pub(super) struct Declared {
    pub parameters: Vec<Parameter>,
    /// One for each entry of each member.
    pub history: Vec<History>,
    pub layout: Vec<Layout>,
    pub stress: Entry,
    pub return_map: Option<Entry>,
    pub evolve: Option<Entry>,
    pub wave_speed: Option<Entry>,
    pub rest: Option<Entry>,
}

/// What the functions of a law look like, for errors.
const SIGNATURES: &str = "fn stress(point: Point, p: Parameters) -> mat3x3<f32>, \
                          fn return_map(point: Point, p: Parameters) -> mat3x3<f32>, \
                          fn evolve(point: Point, p: Parameters, h: History) -> History, \
                          fn wave_speed(p: Parameters, density: f32) -> f32, fn rest(place: vec3<f32>) -> History; the first three \
                          may also take `h: History`";

/// Names of the inputs of a law's programs.
const TAKEN: [&str; 4] = ["dt", "scale", "mass", "density"];

impl Declared {
    /// # Errors
    ///
    /// [`gradreel::ErrorKind::Input`] with the line, for what is missing or of another form.
    pub fn new(parsed: &Parsed) -> Result<Self> {
        let fail = |range: Option<Range<usize>>, what: &str, found: String, fix: &str| {
            parsed.source.error_at(range.unwrap_or(0..0), what, &found, fix)
        };
        let Some(struct_type) = structure(parsed, "Parameters") else {
            return Err(fail(None, "the law has no parameters", "no `struct Parameters`".to_owned(), FORM));
        };
        let mut parameters: Vec<Parameter> = Vec::new();
        for member in members(parsed, struct_type, "Parameters") {
            if member.layout != Some(Layout::Number) {
                return Err(fail(
                    member.range,
                    "a parameter is one number",
                    format!("another type of `{}`", member.name),
                    "use f32",
                ));
            }
            check_name(&member.name, parameters.iter().map(|p| p.name)).map_err(|found| {
                fail(member.range.clone(), "this name cannot be used", found, "choose another name")
            })?;
            match comment::parameter(&member.name, &member.comment) {
                Ok(parameter) => parameters.push(parameter),
                Err(found) => return Err(fail(member.range, "a parameter is not described", found, FORM)),
            }
            if parameters.len() > PARAMETER_LIMIT {
                let found = format!("more than {PARAMETER_LIMIT}");
                return Err(fail(
                    member.range,
                    "the law has too many parameters",
                    found,
                    "fix some of them with `const`",
                ));
            }
        }
        for member in members(parsed, struct_type, "Parameters") {
            let parameter = parameters.iter().find(|p| p.name == member.name);
            let Some(other) = parameter.and_then(|p| p.times) else { continue };
            let base = parameters.iter().find(|p| p.name == other);
            if !base.is_some_and(|base| base.map == Map::Log10 && base.times.is_none()) {
                let found = format!("`{other}`");
                let fix = "name a parameter with log10 whose own usual value is a number";
                return Err(fail(member.range, "a usual value is no multiple of this", found, fix));
            }
        }
        let none = |_: &TypeInner| false;
        let rest = entry(parsed, "rest", &none)?;
        let (mut history, mut layout) = (Vec::new(), Vec::new());
        if let Some(struct_type) = structure(parsed, "History") {
            for member in members(parsed, struct_type, "History") {
                let Some(shape) = member.layout else {
                    let found = format!("another type of `{}`", member.name);
                    return Err(fail(
                        member.range,
                        "this cannot be history",
                        found,
                        "use f32, vec3<f32> or mat3x3<f32>",
                    ));
                };
                check_name(&member.name, parameters.iter().map(|p| p.name)).map_err(|found| {
                    fail(member.range.clone(), "this name cannot be used", found, "choose another name")
                })?;
                match comment::history(&member.comment) {
                    Ok((unit, Start::Value(start))) => history.extend(entries(&member.name, shape, unit, |_| start)),
                    Ok((unit, Start::Identity)) if shape == Layout::Matrix => {
                        history
                            .extend(entries(&member.name, shape, unit, |k| f64::from(u8::from(k.is_multiple_of(4)))));
                    }
                    Ok((unit, Start::Unsaid)) if rest.is_some() => {
                        history.extend(entries(&member.name, shape, unit, |_| 0.0));
                    }
                    other => {
                        let found = match other {
                            Ok((_, Start::Identity)) => "`start identity` of what is no matrix".to_owned(),
                            Ok(_) => "no `start`, and no `fn rest` that says it".to_owned(),
                            Err(found) => found,
                        };
                        return Err(fail(member.range, "a history variable is not described", found, HISTORY_FORM));
                    }
                }
                layout.push(shape);
                if history.len() > HISTORY_LIMIT {
                    let found = format!("more than {HISTORY_LIMIT} numbers, of which a matrix has 9");
                    return Err(fail(member.range, "the law has too much history", found, "keep less of it"));
                }
                for (n, one) in history.iter().enumerate() {
                    let taken = parameters.iter().map(|p| p.name).chain(history[..n].iter().map(|one| one.name));
                    check_name(one.name, taken).map_err(|found| {
                        fail(member.range.clone(), "this name cannot be used", found, "choose another name")
                    })?;
                }
            }
        }
        let matrix = |inner: &TypeInner| layout_of(inner) == Some(Layout::Matrix);
        let number = |inner: &TypeInner| layout_of(inner) == Some(Layout::Number);
        let Some(stress) = entry(parsed, "stress", &matrix)? else {
            return Err(fail(None, "the law has no stress", "no `fn stress`".to_owned(), SIGNATURES));
        };
        let return_map = entry(parsed, "return_map", &matrix)?;
        let evolve = entry(parsed, "evolve", &none)?;
        let wave_speed = entry(parsed, "wave_speed", &number)?;
        // what only varies in space does not evolve
        if (evolve.is_some() || rest.is_some()) == history.is_empty() {
            let found = if history.is_empty() { "no `struct History`" } else { "no `fn evolve`, and no `fn rest`" };
            let fix = "`struct History` belongs to `fn evolve`, or to `fn rest` if it only varies in space";
            return Err(fail(None, "the law does not say how its history evolves", found.to_owned(), fix));
        }
        Ok(Self { parameters, history, layout, stress, return_map, evolve, wave_speed, rest })
    }
}

/// A history variable for each number of a member.
fn entries(member: &str, shape: Layout, unit: &'static str, start: impl Fn(usize) -> f64) -> Vec<History> {
    let at = |k: usize| match shape {
        Layout::Number => member.to_owned(),
        Layout::Vector(_) => format!("{member}{k}"),
        Layout::Matrix => format!("{member}{}{}", k / 3, k % 3),
    };
    (0..shape.len()).map(|k| History { name: name(&at(k)), unit, start: start(k) }).collect()
}

/// Whether a name can be an input of a program beside the others.
fn check_name<'a>(name: &str, mut others: impl Iterator<Item = &'a str>) -> Result<(), String> {
    let entry = |prefix: char| {
        name.strip_prefix(prefix).is_some_and(|rest| rest.len() == 2 && rest.chars().all(|c| matches!(c, '0'..='2')))
    };
    if !name.is_ascii() {
        return Err(format!("`{name}`, which is not ASCII"));
    }
    if TAKEN.contains(&name) || entry('f') || entry('c') || name.starts_with('_') {
        return Err(format!("`{name}`, which names something else"));
    }
    if others.any(|other| other == name) {
        return Err(format!("`{name}` twice"));
    }
    Ok(())
}

struct Member {
    name: String,
    layout: Option<Layout>,
    comment: String,
    /// Where it stands in the user's file.
    range: Option<Range<usize>>,
}

fn structure(parsed: &Parsed, name: &str) -> Option<Handle<Type>> {
    let mut all = parsed.module.types.iter();
    all.find(|(_, ty)| ty.name.as_deref() == Some(name) && matches!(ty.inner, TypeInner::Struct { .. }))
        .map(|(ty, _)| ty)
}

fn layout_of(inner: &TypeInner) -> Option<Layout> {
    match *inner {
        TypeInner::Scalar(scalar) if scalar.kind == ScalarKind::Float => Some(Layout::Number),
        TypeInner::Vector { size, scalar } if scalar.kind == ScalarKind::Float => Some(Layout::Vector(size as usize)),
        TypeInner::Matrix { columns: naga::VectorSize::Tri, rows: naga::VectorSize::Tri, .. } => Some(Layout::Matrix),
        _ => None,
    }
}

fn members(parsed: &Parsed, ty: Handle<Type>, name: &str) -> Vec<Member> {
    let module = &parsed.module;
    let TypeInner::Struct { members, .. } = &module.types[ty].inner else { return Vec::new() };
    let places = places(&parsed.source.user, name);
    let comments = module.doc_comments.as_ref().map(|all| &all.struct_members);
    let found = members.iter().enumerate().map(|(n, member)| {
        let name = member.name.clone().unwrap_or_default();
        let lines = comments.and_then(|all| all.get(&(ty, n))).cloned().unwrap_or_default();
        let lines = lines.iter().map(|line| line.trim_start_matches(['/', '*', ' ']).trim_end_matches(['*', '/', ' ']));
        let range = places.iter().find(|(known, _)| *known == name).map(|(_, range)| range.clone());
        Member {
            layout: layout_of(&module.types[member.ty].inner),
            comment: lines.collect::<Vec<_>>().join(" "),
            range,
            name,
        }
    });
    found.collect()
}

/// The members of a structure and where they stand.
fn places(user: &str, name: &str) -> Vec<(String, Range<usize>)> {
    let all = tokens(user);
    let word = |n: usize| all.get(n).map_or("", |token| &user[token.range.clone()]);
    let Some(start) = (0..all.len()).find(|&n| word(n) == "struct" && word(n + 1) == name) else { return Vec::new() };
    let end = (start..all.len()).find(|&n| word(n) == "}").unwrap_or(all.len());
    let names = (start..end).filter(|&n| all[n].kind == Kind::Word && word(n + 1) == ":");
    names.map(|n| (word(n).to_owned(), all[n].range.clone())).collect()
}

/// A function of the law with this name, if the file has one. It returns `History`, or what `wanted` says.
fn entry(parsed: &Parsed, name: &str, wanted: &dyn Fn(&TypeInner) -> bool) -> Result<Option<Entry>> {
    let module = &parsed.module;
    let Some((handle, function)) = module.functions.iter().find(|(_, f)| f.name.as_deref() == Some(name)) else {
        return Ok(None);
    };
    let span = module.functions.get_span(handle);
    let fail = |found: &str| {
        let fault = Fault::new(span, format!("`{name}` has another form")).found(found).wanted(SIGNATURES);
        Err(parsed.source.error(*fault))
    };
    let called = |ty: Handle<Type>| module.types[ty].name.as_deref().unwrap_or_default();
    let mut roles = Vec::new();
    for argument in &function.arguments {
        let role = match called(argument.ty) {
            _ if name == "rest" && layout_of(&module.types[argument.ty].inner) == Some(Layout::Vector(3)) => {
                Role::Place
            }
            "Point" if !["wave_speed", "rest"].contains(&name) => Role::Point,
            "Parameters" if name != "rest" => Role::Parameters,
            "History" if !["wave_speed", "rest"].contains(&name) => Role::History,
            _ if name == "wave_speed" && layout_of(&module.types[argument.ty].inner) == Some(Layout::Number) => {
                Role::Density
            }
            _ => return fail(&format!("an argument `{}`", argument.name.as_deref().unwrap_or_default())),
        };
        if roles.contains(&role) {
            return fail("two arguments of one type");
        }
        roles.push(role);
    }
    let right = function.result.as_ref().is_some_and(|result| {
        if ["evolve", "rest"].contains(&name) {
            called(result.ty) == "History"
        } else {
            wanted(&module.types[result.ty].inner)
        }
    });
    if right { Ok(Some(Entry { function: handle, roles })) } else { fail("another result") }
}
