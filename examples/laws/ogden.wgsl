// Rubber after Ogden, two terms: tau = U diag(sum_k mu_k (b^a_k - mean) + kappa ln J) U^T, b the stretches at J = 1.

struct Parameters {
    /// Modulus of the first term μ1 [Pa], log10, 1e3 to 1e6
    first: f32,
    /// Modulus of the second term μ2 [Pa], log10, 1e3 to 1e6
    second: f32,
    /// Bulk modulus κ [Pa], log10, 1e4 to 1e7
    bulk: f32,
}

const EXPONENTS = array(1.3, 5.0);

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let l = log(max(stretches(point.f), vec3(0.05)));
    let volume = l.x + l.y + l.z;
    var moduli = array(p.first, p.second);
    var tau = vec3(p.bulk * volume);
    for (var k = 0; k < 2; k++) {
        let b = exp(EXPONENTS[k] * (l - volume / 3.0));
        tau += moduli[k] * (b - (b.x + b.y + b.z) / 3.0);
    }
    return left(point.f, tau);
}
