// Rubber of two layers, each with a stiffness of its own, and fibres around the upright axis of the body.

struct Parameters {
    /// Shear modulus of the lower half μ1 [Pa], log10, 1e3 to 1e6
    lower: f32,
    /// Shear modulus of the upper half μ2 [Pa], log10, 1e3 to 1e6
    upper: f32,
    /// Bulk modulus κ [Pa], log10, 1e4 to 1e7
    bulk: f32,
    /// Modulus of the fibres k [Pa], log10, 1e3 to 1e6
    fibres: f32,
}

struct History {
    /// Share of the upper half [-]
    share: f32,
    /// Direction of the fibres at rest [-]
    direction: vec3<f32>,
}

fn rest(place: vec3<f32>) -> History {
    let around = vec3(-place.z, 0.0, place.x);
    return History(select(0.0, 1.0, place.y > 0.0), around / max(length(around), 1e-6));
}

fn stress(point: Point, p: Parameters, h: History) -> mat3x3<f32> {
    let j = det(point.f);
    let shear = mix(p.lower, p.upper, h.share) * pow(j, -2.0 / 3.0);
    var tau = shear * dev(point.f * transpose(point.f)) + p.bulk * log(j) * identity();
    let a = point.f * h.direction;
    let extension = dot(a, a) - dot(h.direction, h.direction);
    if extension > 0.0 {
        tau += p.fibres * extension * outer(a, a);
    }
    return tau;
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    return sqrt((p.bulk + 4.0 / 3.0 * max(p.lower, p.upper) + 6.0 * p.fibres) / density);
}
