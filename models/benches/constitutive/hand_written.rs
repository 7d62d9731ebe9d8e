//! The law of `mooney_rivlin` in plain Rust with its derivative worked out by hand, compiled for AVX-512 where there is any.

/// `c₁`, `c₂`, `K` \[Pa\].
pub const PARAMETERS: [f32; 3] = [2e4, 5e3, 2e5];

type Matrix = [f32; 9];

/// Stress of 256 particles and, given the cotangent of the stress, the cotangent of the deformation behind it.
pub fn run(f: [&[f32]; 9], cotangent: Option<&Matrix>, results: &mut [f32]) {
    #[cfg(target_arch = "x86_64")]
    if gradreel::isa() == "avx512" && is_x86_feature_detected!("fma") {
        #[target_feature(enable = "avx512f,fma")]
        fn wide(f: [&[f32]; 9], cotangent: Option<&Matrix>, results: &mut [f32]) {
            each(f, cotangent, results);
        }
        // SAFETY: the processor has the path of the run, and FMA was just detected.
        return unsafe { wide(f, cotangent, results) };
    }
    each(f, cotangent, results);
}

#[inline(always)]
fn each(f: [&[f32]; 9], cotangent: Option<&Matrix>, results: &mut [f32]) {
    let len = f[0].len();
    for p in 0..len {
        let mut one = [0.0; 9];
        for k in 0..9 {
            one[k] = f[k][p];
        }
        let (tau, on_f) = law(&one, cotangent);
        for k in 0..9 {
            results[k * len + p] = tau[k];
        }
        if cotangent.is_some() {
            for k in 0..9 {
                results[(9 + k) * len + p] = on_f[k];
            }
        }
    }
}

#[inline(always)]
fn law(f: &Matrix, cotangent: Option<&Matrix>) -> (Matrix, Matrix) {
    let [c1, c2, bulk] = PARAMETERS;
    let cofactor = [
        f[4] * f[8] - f[5] * f[7],
        f[5] * f[6] - f[3] * f[8],
        f[3] * f[7] - f[4] * f[6],
        f[2] * f[7] - f[1] * f[8],
        f[0] * f[8] - f[2] * f[6],
        f[1] * f[6] - f[0] * f[7],
        f[1] * f[5] - f[2] * f[4],
        f[2] * f[3] - f[0] * f[5],
        f[0] * f[4] - f[1] * f[3],
    ];
    let j = f[0] * cofactor[0] + f[1] * cofactor[1] + f[2] * cofactor[2];
    let scale = (j.ln() * (-2.0 / 3.0)).exp();
    let plain = times_transposed(f, f);
    let mut b = plain;
    for k in 0..9 {
        b[k] = plain[k] * scale;
    }
    let factor = c1 + c2 * trace(&b);
    let square = times_transposed(&b, &b);
    let mut tau = [0.0; 9];
    for k in 0..9 {
        tau[k] = 2.0 * (factor * b[k] - c2 * square[k]);
    }
    let shift = bulk * j * (j - 1.0) - trace(&tau) / 3.0;
    for k in [0, 4, 8] {
        tau[k] += shift;
    }
    let Some(g) = cotangent else { return (tau, [0.0; 9]) };
    // D = 2 dev sym g; cotangent of b̄: factor D + c₂ (D : b̄) I − c₂ (D b̄ + b̄ D)
    let mut d = [0.0; 9];
    for k in 0..9 {
        d[k] = g[k] + g[k % 3 * 3 + k / 3];
    }
    let third = trace(&d) / 3.0;
    for k in [0, 4, 8] {
        d[k] -= third;
    }
    let product = times_transposed(&d, &b);
    let along = c2 * dot(&d, &b);
    let mut on_b = [0.0; 9];
    for k in 0..9 {
        let diagonal = if k % 4 == 0 { along } else { 0.0 };
        on_b[k] = factor * d[k] + diagonal - c2 * (product[k] + product[k % 3 * 3 + k / 3]);
    }
    let on_j = bulk * (2.0 * j - 1.0) * trace(g) + dot(&on_b, &plain) * (-2.0 / 3.0) * scale / j;
    let mut on_f = [0.0; 9];
    for i in 0..3 {
        for k in 0..3 {
            let moved = on_b[3 * i] * f[k] + on_b[3 * i + 1] * f[3 + k] + on_b[3 * i + 2] * f[6 + k];
            on_f[3 * i + k] = 2.0 * scale * moved + on_j * cofactor[3 * i + k];
        }
    }
    (tau, on_f)
}

/// `A Bᵀ`
#[inline(always)]
fn times_transposed(a: &Matrix, b: &Matrix) -> Matrix {
    let mut product = [0.0; 9];
    for i in 0..3 {
        for j in 0..3 {
            product[3 * i + j] = a[3 * i] * b[3 * j] + a[3 * i + 1] * b[3 * j + 1] + a[3 * i + 2] * b[3 * j + 2];
        }
    }
    product
}

#[inline(always)]
fn trace(a: &Matrix) -> f32 {
    a[0] + a[4] + a[8]
}

#[inline(always)]
fn dot(a: &Matrix, b: &Matrix) -> f32 {
    let mut sum = 0.0;
    for k in 0..9 {
        sum += a[k] * b[k];
    }
    sum
}
