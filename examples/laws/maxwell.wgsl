// A spring beside a Maxwell branch: neo-Hookean, and a second spring that relaxes with a time of its own.

struct Parameters {
    /// Shear modulus at rest μ [Pa], log10, 1e3 to 1e6
    shear: f32,
    /// Bulk modulus κ [Pa], log10, 1e4 to 1e7
    bulk: f32,
    /// Shear modulus of the branch μ1 [Pa], log10, 1e3 to 1e6
    branch: f32,
    /// Relaxation time t1 [s], log10, 1e-3 to 1
    relaxation: f32,
}

struct History {
    /// Elastic left Cauchy-Green tensor of the branch [-], start identity
    elastic: mat3x3<f32>,
}

fn evolve(point: Point, p: Parameters, h: History) -> History {
    let step = identity() + point.dt * point.c;
    let trial = step * h.elastic * transpose(step);
    let keep = 1.0 / (1.0 + point.dt / p.relaxation);
    // towards the isotropic tensor of the same volume
    let volume = pow(det(trial), 1.0 / 3.0);
    return History(keep * trial + (1.0 - keep) * volume * identity());
}

fn unimodular(b: mat3x3<f32>) -> mat3x3<f32> {
    return pow(det(b), -1.0 / 3.0) * b;
}

fn stress(point: Point, p: Parameters, h: History) -> mat3x3<f32> {
    let spring = p.shear * dev(unimodular(point.f * transpose(point.f)));
    return spring + p.branch * dev(unimodular(h.elastic)) + p.bulk * log(det(point.f)) * identity();
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    return sqrt((p.bulk + 4.0 * (p.shear + p.branch) / 3.0) / density);
}
