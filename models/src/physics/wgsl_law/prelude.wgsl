// What every law may use. This text follows the user's; the functions marked "intrinsic" have no body of use here.

struct Point {
    f: mat3x3<f32>,
    previous: mat3x3<f32>,
    c: mat3x3<f32>,
    dt: f32,
}

struct Svd {
    u: mat3x3<f32>,
    s: vec3<f32>,
    v: mat3x3<f32>,
}

// intrinsic: F = U diag(s) V^T with rotations U, V; s descends, its last entry has the sign of det F
fn svd(a: mat3x3<f32>) -> Svd { return Svd(a, a[0], a); }

// intrinsic: the singular values of svd(a)
fn stretches(a: mat3x3<f32>) -> vec3<f32> { return a[0]; }

// intrinsic: U diag(d) V^T in the frames of svd(a)
fn two_point(a: mat3x3<f32>, d: vec3<f32>) -> mat3x3<f32> { return a; }

// intrinsic: U diag(d) U^T in the frames of svd(a)
fn left(a: mat3x3<f32>, d: vec3<f32>) -> mat3x3<f32> { return a; }

// intrinsic: V diag(d) V^T in the frames of svd(a)
fn right(a: mat3x3<f32>, d: vec3<f32>) -> mat3x3<f32> { return a; }

// intrinsic: ln(1 + exp x), 1 / (1 + exp -x), ln(1 + x), exp x - 1, the error function
fn softplus(x: f32) -> f32 { return x; }
fn logistic(x: f32) -> f32 { return x; }
fn log1p(x: f32) -> f32 { return x; }
fn expm1(x: f32) -> f32 { return x; }
fn erf(x: f32) -> f32 { return x; }

// intrinsic: det A, A^-1, and det A A^-T, which exists for singular matrices too
fn det(a: mat3x3<f32>) -> f32 { return a[0].x; }
fn inverse(a: mat3x3<f32>) -> mat3x3<f32> { return a; }
fn cofactor(a: mat3x3<f32>) -> mat3x3<f32> { return a; }

// intrinsic: tr A, A : B, A - tr A / 3 I, (A + A^T) / 2, a b^T, diag(d)
fn trace(a: mat3x3<f32>) -> f32 { return a[0].x; }
fn ddot(a: mat3x3<f32>, b: mat3x3<f32>) -> f32 { return a[0].x; }
fn dev(a: mat3x3<f32>) -> mat3x3<f32> { return a; }
fn sym(a: mat3x3<f32>) -> mat3x3<f32> { return a; }
fn outer(a: vec3<f32>, b: vec3<f32>) -> mat3x3<f32> { return mat3x3<f32>(a, a, a); }
fn diagonal(d: vec3<f32>) -> mat3x3<f32> { return mat3x3<f32>(d, d, d); }

fn identity() -> mat3x3<f32> {
    return mat3x3<f32>(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0);
}

// Lame's (mu, lambda) from Young's modulus and Poisson's ratio
fn lame(young: f32, poisson: f32) -> vec2<f32> {
    return vec2<f32>(young / (2.0 * (1.0 + poisson)),
        young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)));
}
