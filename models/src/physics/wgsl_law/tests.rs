//! Laws in WGSL against the same laws in Rust, the language, and its limits.

use gradreel::scalar::{Mat3, Program};
use gradreel::{ErrorKind, Result};

use super::WgslLaw;
use crate::physics::material::{Given, Material, Point};
use crate::physics::materials::{
    DruckerPrager, FixedCorotated, NeoHookean, Newtonian, Snow, StvkHencky, Viscoplastic, VonMises,
};
use crate::physics::parameters::Map;

/// `F, previous, C, dt, parameters, history ↦ F′, τ, history′`
fn program(material: &dyn Material) -> Program {
    let (parameters, history) = (material.parameters(), material.history());
    let fixed = ["f", "p", "c"].iter().flat_map(|part| (0..9).map(move |k| format!("{part}_{k}")));
    let names: Vec<String> = fixed
        .chain(["dt".to_owned()])
        .chain(parameters.iter().map(|p| p.name.to_owned()))
        .chain(history.iter().map(|h| h.name.to_owned()))
        .collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let outputs: Vec<String> = (0..18 + history.len()).map(|k| format!("y_{k}")).collect();
    let outputs: Vec<&str> = outputs.iter().map(String::as_str).collect();
    Program::trace("law", &names, &outputs, |x| {
        let matrix = |at: usize| Mat3::from_slice(&x[at..]);
        let trial = Point { f: matrix(0), previous: matrix(9), c: matrix(18) };
        let mut given = Given {
            values: parameters.iter().map(|p| p.name).zip(x[28..].iter().copied()).collect(),
            history: history.iter().map(|h| h.name).zip(x[28 + parameters.len()..].iter().copied()).collect(),
            dt: x[27],
        };
        let f = material.return_map(&trial, &given).unwrap_or(trial.f);
        let evolved = material.evolve(&trial, &given);
        given.history = history.iter().map(|h| h.name).zip(evolved.iter().copied()).collect();
        [f.to_vec(), material.stress(&Point { f, ..trial }, &given).to_vec(), evolved].concat()
    })
}

/// Numbers in [−1, 1] from a seed.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Random inputs of a law: deformation of this size about rest, parameters over their priors.
fn inputs(material: &dyn Material, seed: u64, size: f64) -> Vec<f64> {
    let mut draw = noise(seed);
    let mut matrix = |by: f64| -> Vec<f64> { (0..9).map(|k| f64::from(u8::from(k % 4 == 0)) + by * draw()).collect() };
    let mut all = matrix(size);
    all.extend(matrix(size));
    all.extend((0..9).map(|_| 20.0 * draw()));
    all.push(1e-4);
    all.extend(material.parameters().iter().map(|p| {
        let share = 0.5 + 0.45 * draw();
        match p.map {
            Map::Log10 => p.prior[0] * (p.prior[1] / p.prior[0]).powf(share),
            _ => p.prior[0] + share * (p.prior[1] - p.prior[0]),
        }
    }));
    all.extend(material.history().iter().map(|h| h.start + 0.1 * draw()));
    all
}

macro_rules! shipped {
    ($($name:literal => $material:expr;)*) => {
        vec![$(($name, Box::new($material) as Box<dyn Material>, include_str!(concat!("../../../laws/", $name, ".wgsl")))),*]
    };
}

fn pairs() -> Vec<(&'static str, Box<dyn Material>, &'static str)> {
    shipped! {
        "drucker_prager" => DruckerPrager;
        "fixed_corotated" => FixedCorotated;
        "neo_hookean" => NeoHookean;
        "newtonian" => Newtonian;
        "snow" => Snow;
        "stvk_hencky" => StvkHencky;
        "viscoplastic" => Viscoplastic::default();
        "von_mises" => VonMises::default();
    }
}

#[test]
fn the_shipped_laws_are_the_same_in_wgsl_and_in_rust() {
    for (name, rust, text) in pairs() {
        let wgsl = WgslLaw::parse(&format!("{name}.wgsl"), text).unwrap();
        assert_eq!(wgsl.name(), name);
        assert_eq!(wgsl.survives_inversion(), rust.survives_inversion(), "{name}");
        assert_eq!(wgsl.history(), rust.history(), "{name}");
        for (ours, theirs) in wgsl.parameters().iter().zip(rust.parameters()) {
            assert_eq!((ours.name, ours.symbol, ours.unit), (theirs.name, theirs.symbol, theirs.unit), "{name}");
            assert_eq!((ours.map, ours.times, ours.by_compression), (theirs.map, theirs.times, theirs.by_compression));
            let close = |a: f64, b: f64| assert!((a - b).abs() <= 1e-12 * b.abs(), "{name} {}: {a}, {b}", ours.name);
            close(ours.start, theirs.start);
            (0..2).for_each(|k| close(ours.prior[k], theirs.prior[k]));
            (0..2).for_each(|k| close(ours.usual[k], theirs.usual[k]));
        }
        assert_eq!(wgsl.parameters().len(), rust.parameters().len());
        let values: Vec<f64> = rust.parameters().iter().map(|p| p.start).collect();
        let (a, b) = (wgsl.wave_speed(&values, 1100.0), rust.wave_speed(&values, 1100.0));
        assert!((a - b).abs() < 1e-7 * b, "{name}: {a} m/s, {b} m/s");
        let (ours, theirs) = (program(&wgsl), program(&*rust));
        let (our_slope, their_slope) = (ours.vjp(), theirs.vjp());
        for seed in 0..60 {
            let mut x = inputs(&*rust, seed + 1, [0.01, 0.1, 0.3][seed as usize % 3]);
            let compare = |a: Vec<f64>, b: Vec<f64>, what: &str| {
                let scale = b.iter().fold(0.0_f64, |most, y| most.max(y.abs()));
                for (a, b) in a.iter().zip(&b) {
                    // a constant that WGSL computes, such as √(2/3), is one of `f32`
                    let rounding = if text.contains("2.0 / 3.0") || text.contains("8.0 / 3.0") { 3e-7 } else { 1e-11 };
                    let alike = (a - b).abs() <= rounding * (b.abs() + 1e-1 * scale) || (a.is_nan() && b.is_nan());
                    assert!(alike, "{name}, state {seed}, {what}: {a} and {b}");
                }
            };
            compare(ours.eval(&x), theirs.eval(&x), "value");
            let mut draw = noise(seed + 1000);
            x.extend((0..theirs.outputs().len()).map(|_| draw()));
            compare(our_slope.eval(&x), their_slope.eval(&x), "gradient");
        }
    }
}

#[test]
fn a_law_in_wgsl_is_not_longer_than_in_rust() {
    for (name, rust, text) in pairs() {
        let wgsl = WgslLaw::parse(&format!("{name}.wgsl"), text).unwrap();
        let (ours, theirs) = (program(&wgsl).vjp().len(), program(&*rust).vjp().len());
        assert!(ours * 10 <= theirs * 11, "{name}: {ours} operations in WGSL, {theirs} in Rust");
    }
}

/// The stress of a law with parameter `a` whose body is this text, at `F = diag(x, 1, 1)` and `a = 2`.
fn stress(body: &str, x: f64) -> Result<Vec<f64>> {
    let law = WgslLaw::parse("t.wgsl", &text(body))?;
    let mut inputs = vec![x, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    inputs.extend([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    inputs.extend([0.0; 9]);
    inputs.extend([1e-3, 2.0]);
    Ok(program(&law).eval(&inputs)[9..].to_vec())
}

fn text(body: &str) -> String {
    format!("struct Parameters {{\n/// A number a [-], linear, 0 to 4\na: f32,\n}}\n{body}\n")
}

/// `τ₀₀` of a stress that is a number times the identity.
fn number(code: &str, x: f64) -> f64 {
    let body = format!(
        "fn g(x: f32, p: Parameters) -> f32 {{ {code} }}
        fn stress(point: Point, p: Parameters) -> mat3x3<f32> {{ return g(point.f[0].x, p) * identity(); }}"
    );
    stress(&body, x).unwrap_or_else(|error| panic!("{code}: {error}"))[0]
}

#[test]
fn the_language_means_what_wgsl_says() {
    let cases: [(&str, &dyn Fn(f64) -> f64); 22] = [
        ("return p.a * x + 0.1;", &|x| 2.0 * x + 0.1),
        ("if x > 1.0 { return 3.0; } return x;", &|x| if x > 1.0 { 3.0 } else { x }),
        ("var y = x; if x > 1.0 { y = y * y; } else if x > 0.5 { y += 1.0; } return y;", &|x| {
            if x > 1.0 {
                x * x
            } else if x > 0.5 {
                x + 1.0
            } else {
                x
            }
        }),
        ("var s = 0.0; for (var i = 0; i < 5; i++) { s += pow(x, f32(i)); } return s;", &|x| {
            (0..5).map(|i| x.powi(i)).sum()
        }),
        // a break that depends on the particle, and what is known after it
        ("var s = 0.0; for (var i = 0; i < 9; i++) { s += x; if s > 3.0 { break; } s += 0.01; } return s;", &|x| {
            let mut s = 0.0;
            for _ in 0..9 {
                s += x;
                if s > 3.0 {
                    break;
                }
                s += 0.01;
            }
            s
        }),
        (
            "var s = 0.0; for (var i = 0; i < 6; i++) { if x * f32(i) > 3.0 { continue; } s += f32(i); } return s;",
            &|x| (0..6).map(f64::from).filter(|i| x * i <= 3.0).sum(),
        ),
        ("for (var i = 0; i < 4; i++) { if x > f32(i) + 0.5 { return f32(i); } } return -1.0;", &|x| {
            (0..4).map(f64::from).find(|i| x > i + 0.5).unwrap_or(-1.0)
        }),
        (
            "var n = 0; var s = 0.0; loop { s += x; n++; if n == 3 { break; } continuing { s += 1.0; } } return s;",
            &|x| 3.0 * x + 2.0,
        ),
        ("switch 2 { case 1: { return 1.0; } case 2, 3: { return 2.0 * x; } default: { return 0.0; } }", &|x| 2.0 * x),
        ("let b = x > 0.5 && p.a > 3.0 || x < 0.2; return select(1.0, 2.0, b);", &|x| if x < 0.2 { 2.0 } else { 1.0 }),
        ("var a = array<f32, 3>(1.0, x, 3.0); a[2] += x; return a[0] + a[1] * a[2];", &|x| 1.0 + x * (3.0 + x)),
        ("var v = vec3(x, 2.0, 3.0); v.y = x; return dot(v.zyx, vec3(1.0, 10.0, 100.0)) + length(v);", &|x| {
            3.0 + 10.0 * x + 100.0 * x + (2.0 * x * x + 9.0).sqrt()
        }),
        ("let m = mat2x2(1.0, 2.0, 3.0, x); let v = m * vec2(5.0, 6.0); return v.x + 100.0 * v.y;", &|x| {
            23.0 + 100.0 * (10.0 + 6.0 * x)
        }),
        (
            "let m = mat2x3(1.0, 2.0, 3.0, 4.0, 5.0, x); return (vec3(1.0, 1.0, 1.0) * m).y + determinant(mat2x2(x, 2.0, 3.0, 4.0));",
            &|x| 9.0 + x + 4.0 * x - 6.0,
        ),
        ("return fract(x) + trunc(-x) + round(2.5) + sign(x) + step(1.0, x) + saturate(x) + x % 0.3;", &|x| {
            x.fract() + (-x).trunc() + 2.0 + 1.0 + f64::from(u8::from(x >= 1.0)) + x.min(1.0) + x % 0.3
        }),
        ("return sinh(x) + cosh(x) + asinh(x) + atanh(0.3 * x) + exp2(x) + log2(x) + inverseSqrt(x);", &|x| {
            x.sinh() + x.cosh() + x.asinh() + (0.3 * x).atanh() + x.exp2() + x.log2() + 1.0 / x.sqrt()
        }),
        (
            "return mix(1.0, x, 0.25) + smoothstep(0.0, 2.0, x) + clamp(x, 0.4, 0.6) + fma(x, x, 1.0) + distance(x, 3.0);",
            &|x| {
                let t = (x / 2.0).clamp(0.0, 1.0);
                0.75 + 0.25 * x + t * t * (3.0 - 2.0 * t) + x.clamp(0.4, 0.6) + x * x + 1.0 + (x - 3.0).abs()
            },
        ),
        ("return f32(7 / 2 + 7 % 4 - (1 << 3)) + f32(u32(5) & 4u) + f32(x > 0.0);", &|_| 3.0 + 3.0 - 8.0 + 4.0 + 1.0),
        // a function that writes through a pointer, also in one branch only
        ("var y = x; if x > 1.0 { twice(&y); } return y;", &|x| if x > 1.0 { 2.0 * x } else { x }),
        (
            "let s = svd(mat3x3<f32>(vec3(x, 0.0, 0.0), vec3(0.0, 0.1, 0.0), vec3(0.0, 0.0, 0.01))); return s.s.x + det(s.u);",
            &|x| x + 1.0,
        ),
        (
            "let m = diagonal(vec3(x, 2.0, 3.0)); return trace(inverse(m)) + ddot(m, m) + trace(dev(m) * m) + cofactor(m)[0].x;",
            &|x| {
                let mean = (x + 5.0) / 3.0;
                1.0 / x
                    + 0.5
                    + 1.0 / 3.0
                    + x * x
                    + 13.0
                    + (x - mean) * x
                    + (2.0 - mean) * 2.0
                    + (3.0 - mean) * 3.0
                    + 6.0
            },
        ),
        ("return softplus(x) + logistic(x) + log1p(x) + expm1(x) + erf(0.0);", &|x| {
            x.exp().ln_1p() + 1.0 / (1.0 + (-x).exp()) + x.ln_1p() + x.exp_m1()
        }),
    ];
    for (code, wanted) in cases {
        for x in [0.15, 0.7, 1.3, 2.6] {
            let with_helper = format!("{code} }} fn twice(y: ptr<function, f32>) {{ *y = 2.0 * *y;");
            let found = number(if code.contains("twice") { &with_helper } else { code }, x);
            let wanted = wanted(x);
            assert!((found - wanted).abs() < 1e-12 * (1.0 + wanted.abs()), "{code} at {x}: {found}, not {wanted}");
        }
    }
}

#[test]
fn decimals_mean_what_they_say_in_double_precision() {
    assert_eq!(number("return 0.1 + 1e-9 * x;", 1.0), 0.1 + 1e-9);
    assert_eq!(number("let v = vec3f(0.1, 0.2, 0.3); return v.z + 0.7f;", 1.0), 0.3 + 0.7);
    assert_eq!(number("return p.a * x / 3.0;", 1.0), 2.0 / 3.0);
}

#[test]
fn columns_come_first_as_in_wgsl() {
    let body = "fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
        return mat3x3<f32>(vec3(1.0, 2.0, 3.0), vec3(4.0, 5.0, 6.0), vec3(7.0, 8.0, 9.0));
    }";
    assert_eq!(stress(body, 1.0).unwrap(), [1.0, 4.0, 7.0, 2.0, 5.0, 8.0, 3.0, 6.0, 9.0]);
}

/// A body, and what its error names: the line of the file (the body begins in line 5), and words.
const WRONG: [(&str, &str, &str); 26] = [
    ("fn stress(point: Point, p: Parameters) -> mat3x3<f32> {\n  return p.b * identity();\n}", "t.wgsl:6:12", "b"),
    ("fn stress(point: Point, p: Parameters) -> mat3x3<f32> {\n  return point.f\n}", "t.wgsl:7:1", "WGSL"),
    ("fn stress(point: Point, p: Parameters) -> mat3x3<f32> {\n  return point.f;", "t.wgsl:6", "WGSL"),
    ("fn stress(point: Point, p: Parameters) -> mat3x3<f32> {\n  let x = 1.0; return x;\n}", "t.wgsl:", "WGSL"),
    ("fn strain() -> f32 { return 1.0; }", "t.wgsl", "no `fn stress`"),
    ("fn stress(point: Point, q: f32) -> mat3x3<f32> { return point.f; }", "t.wgsl:5", "`q`"),
    ("fn stress(point: Point) -> vec3<f32> { return point.f[0]; }", "t.wgsl:5", "another result"),
    ("fn trace(x: f32) -> f32 { return x; }\nfn stress(p: Point) -> mat3x3<f32> { return p.f; }", "t.wgsl:5", "trace"),
    (
        "@group(0) @binding(0) var t: texture_2d<f32>;\nfn stress(p: Point) -> mat3x3<f32> { return p.f * textureLoad(t, vec2(0, 0), 0).x; }",
        "t.wgsl:6",
        "cannot be used",
    ),
    (
        "var<private> k: f32 = 1.0;\nfn stress(p: Point) -> mat3x3<f32> { return k * p.f; }",
        "t.wgsl:6",
        "outside functions",
    ),
    (
        "fn stress(p: Point) -> mat3x3<f32> {\n var x = 0.0;\n while x < p.f[0].x { x += 0.1; }\n return x * p.f; }",
        "t.wgsl:7",
        "no constant bound",
    ),
    (
        "fn stress(p: Point) -> mat3x3<f32> {\n for (var i = 0; i < 4000; i++) { for (var j = 0; j < 4000; j++) { } }\n return p.f; }",
        "t.wgsl:6",
        "too much",
    ),
    (
        "fn stress(p: Point) -> mat3x3<f32> {\n var f = p.f;\n for (var i = 0; i < 400; i++) { f = f * p.f; }\n return f; }",
        "t.wgsl:7",
        "10000 operations",
    ),
    (
        "fn f(x: f32) -> f32 { return f(x); }\nfn stress(p: Point) -> mat3x3<f32> { return f(1.0) * p.f; }",
        "t.wgsl:5",
        "recursive",
    ),
    ("fn stress(p: Point) -> mat3x3<f32> {\n let i = i32(p.f[0].x);\n return p.f * f32(i); }", "t.wgsl:6", "integer"),
    (
        "fn stress(p: Point) -> mat3x3<f32> {\n var i = 0;\n if p.f[0].x > 1.0 { i = 1; }\n return f32(i) * p.f; }",
        "t.wgsl:8",
        "integer",
    ),
    ("fn stress(p: Point) -> mat3x3<f32> {\n return p.f * acos(0.5 * p.f[0].x); }", "t.wgsl:6", "`acos`"),
    (
        "fn stress(p: Point) -> mat3x3<f32> {\n var a = array<f32, 2>();\n for (var i = 0; i < 3; i++) { a[i] = 1.0; }\n return p.f; }",
        "t.wgsl:7",
        "out of range",
    ),
    ("fn stress(p: Point) -> mat3x3<f64> { return p.f; }", "t.wgsl:5:31", "f64"),
    ("fn stress(p: Point) -> mat3x3<f32> { return 1.0h * p.f; }", "t.wgsl:5:45", "f16"),
    (
        "struct History {\n/// x [-], start 1\nx: f32,\n}\nfn stress(p: Point) -> mat3x3<f32> { return p.f; }",
        "t.wgsl",
        "evolve",
    ),
    (
        "struct History {\n/// x [-]\nx: f32,\n}\nfn stress(p: Point) -> mat3x3<f32> { return p.f; }",
        "t.wgsl:7:1",
        "start",
    ),
    (
        "struct History {\n/// x [-], start 1\nx: f32,\n}\nfn rest(x: f32) -> History { return History(x); }\n\
         fn stress(p: Point) -> mat3x3<f32> { return p.f; }",
        "t.wgsl:9",
        "another form",
    ),
    (
        "fn rest(x: vec3<f32>) -> f32 { return x.x; }\nfn stress(p: Point) -> mat3x3<f32> { return p.f; }",
        "t.wgsl:5",
        "form",
    ),
    (
        "fn stress(p: Point) -> mat3x3<f32> { var x = array<f32, 100000>(); return x[0] * p.f; }",
        "t.wgsl:5",
        "too large",
    ),
    ("fn stress(p: Point) -> mat3x3<f32> { return bitcast<f32>(1u) * p.f; }", "t.wgsl:5", ""),
];

#[test]
fn errors_name_the_line_of_the_file() {
    for (body, place, words) in WRONG {
        let error = WgslLaw::parse("t.wgsl", &text(body)).expect_err(body);
        let message = error.to_string();
        assert_eq!(error.kind(), ErrorKind::Input, "{message}");
        assert!(message.contains(place) && message.contains(words), "{body}\n{message}");
    }
}

/// A comment of a parameter, and what its error says.
const UNDESCRIBED: [(&str, &str); 15] = [
    ("", "no unit"),
    ("/// A number", "no unit"),
    ("/// A number [Pa", "no `]`"),
    ("/// A number [], log10, 1 to 2", "empty unit"),
    ("/// A number [Pa], log10", "no plausible range"),
    ("/// A number [Pa], 1 to 2", "no map"),
    ("/// A number [Pa], log10, linear, 1 to 2", "more than one map"),
    ("/// A number [Pa], log10, 0 to 2", "log10 with a range from 0"),
    ("/// A number [Pa], linear, 2 to 1", "not the smaller"),
    ("/// A number [Pa], linear, 1 to x", "`x`, which is no number"),
    ("/// A number [Pa], linear, 1 to inf", "`inf`"),
    ("/// A number [Pa], between 0 and 1, 0.5 to 2", "exceeds the limits"),
    ("/// A number [Pa], log10, 1 to 2, start -1", "cannot reach"),
    ("/// A number [Pa], log10, 1 to 2, usually 3", "without a deviation"),
    ("/// A number [Pa], log10, 1 to 2, usually 3 times b +- 0.1", "`b`"),
];

#[test]
fn parameters_are_described() {
    for (comment, words) in UNDESCRIBED {
        let text = format!(
            "struct Parameters {{\n    {comment}\n    a: f32,\n}}\nfn stress(p: Point) -> mat3x3<f32> {{ return p.f; }}"
        );
        let error = WgslLaw::parse("t.wgsl", &text).expect_err(comment).to_string();
        assert!(error.contains("t.wgsl:3:5") && error.contains(words), "{comment}: {error}");
    }
    for name in ["f01", "dt", "mass", "scale", "é"] {
        let text =
            text("fn stress(p: Point) -> mat3x3<f32> { return p.f; }").replace("a: f32", &format!("{name}: f32"));
        let error = WgslLaw::parse("t.wgsl", &text).unwrap_err().to_string();
        assert!(error.contains("t.wgsl:3:1") && error.contains(name), "{error}");
    }
}

#[test]
fn any_length_is_refused_in_time() {
    let good = "fn stress(p: Point) -> mat3x3<f32> { return p.f; }\n";
    let long = [
        format!("{}{}", text(good), " ".repeat(256 << 10)),
        text(&format!("fn f() -> f32 {{ return {}1.0; }}\n{good}", "1.0+".repeat(60_000))),
        text(&format!("fn f() -> f32 {{ return {}1.0; }}\n{good}", "(".repeat(100_000))),
        text(&format!("fn f() -> f32 {{ return {}1.0; }}\n{good}", "-".repeat(100_000))),
        text(&format!("fn f(x: f32) {{ if x > 0.0 {{ }} {} }}\n{good}", "else if x > 1.0 { } ".repeat(10_000))),
        text(&format!("fn f(x: f32) {{ {} {} }}\n{good}", "{".repeat(100_000), "}".repeat(100_000))),
        text(&format!("fn stress(p: Point) -> mat3x3<f32> {{ {} return p.f; }}", "var a = 1.0; { ".repeat(9_000))),
        text(&format!("alias T = {}f32{};\n{good}", "array<".repeat(20_000), ",2>".repeat(20_000))),
        text(&format!("/* {} {good}", "/*".repeat(100_000))),
    ];
    for text in long {
        let start = std::time::Instant::now();
        let error = WgslLaw::parse("t.wgsl", &text).expect_err("too long");
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(start.elapsed().as_secs() < 10, "{error}");
    }
    // calls of calls
    let chain: String = (0..2000).map(|n| format!("fn g{n}(x: f32) -> f32 {{ return g{}(x); }}\n", n + 1)).collect();
    let text = text(&format!(
        "{chain}fn g2000(x: f32) -> f32 {{ return x; }}\nfn stress(p: Point) -> mat3x3<f32> {{ return g0(1.0) * p.f; }}"
    ));
    let error = WgslLaw::parse("t.wgsl", &text).unwrap_err().to_string();
    assert!(error.contains("too many functions call one another"), "{error}");
}

#[test]
fn the_history_of_a_law_may_be_a_tensor() {
    let text = include_str!("../../../../examples/laws/maxwell.wgsl");
    let law = WgslLaw::parse("maxwell.wgsl", text).unwrap();
    let history = law.history();
    assert_eq!(history.len(), 9);
    assert_eq!(history.iter().map(|h| h.start).collect::<Vec<_>>(), [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    assert_eq!(history[1].name, "elastic01");
    // τ = μ₁ dev b̄ of the branch: held in shear, it relaxes by 1/(1 + dt/t₁) a substep
    let program = program(&law);
    let unit = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let values = [1e3, 1e5, 2e4, 0.01];
    let branch = [1.0, 0.2, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0, 1.0];
    let inputs = [&unit[..], &unit, &[0.0; 9], &[1e-3], &values, &branch].concat();
    let found = program.eval(&inputs);
    let kept: f64 = 0.2 / (1.0 + 1e-3 / 0.01);
    assert!((found[18 + 1] - kept).abs() < 1e-15);
}

/// Direction of fibres, a region and a tensor that start from the place.
#[test]
fn history_starts_from_the_place() {
    let body = "struct History {
            /// direction [-]
            d: vec3<f32>,
            /// elastic part [-], start identity
            e: mat3x3<f32>,
            /// upper [-], start 0.5
            upper: f32,
        }
        fn rest(x: vec3<f32>) -> History {
            return History(normalize(x), diagonal(x), select(0.0, 1.0, x.y > 0.0));
        }
        fn stress(p: Point, h: History) -> mat3x3<f32> { return h.upper * outer(p.f * h.d, p.f * h.d) * h.e; }";
    let law = crate::physics::Law::of(WgslLaw::parse("t.wgsl", &text(body)).unwrap());
    let placed = law.placed(&[[0.0, 3.0, -4.0], [2.0, -1.0, 0.0]]);
    let start = placed.history_at(0);
    assert_eq!((&start[..3], start[12]), (&[0.0, 0.6, -0.8][..], 1.0));
    assert_eq!(start[3..12], [0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, -4.0]);
    assert_eq!(placed.history_at(1)[12], 0.0);
    // what does not evolve stays
    let identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let inputs = [&identity[..], &[0.0; 9], &[1e-4, 1e5], &start].concat();
    assert_eq!(law.program().eval(&inputs)[18..], start);
    // checks look somewhere in particular, and a law that is alike everywhere stays as it is
    assert!(law.varies() && law.history()[12].start == 1.0);
    let alike = crate::physics::materials::find("snow").unwrap();
    assert!(!alike.varies() && alike.placed(&[[0.0; 3]]).history_at(7) == [1.0]);
}
