// Sand, dry or damp: friction limits the shear strain; in expansion the grains separate.

struct Parameters {
    /// Young's modulus E [Pa], log10, 1e3 to 1e7
    young: f32,
    /// Poisson's ratio ν [-], between -0.45 and 0.45, 0 to 0.45, usually 0.30 +- 0.11
    poisson: f32,
    /// Friction angle φ [deg], between 0 and 90, 10 to 50
    friction_angle: f32,
    /// Cohesion c [-], linear, 0 to 0.01, start 0
    cohesion: f32,
}

fn return_map(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let sine = sin(radians(p.friction_angle));
    let friction = sqrt(8.0 / 3.0) * sine / (3.0 - sine);
    let strain = log(max(stretches(point.f), vec3(0.05)));
    let total = strain.x + strain.y + strain.z;
    let mean = total / 3.0;
    let expansion = total - 3.0 * p.cohesion;
    let shear = strain - mean;
    let length = sqrt(dot(shear, shear) + 1e-8);
    let slip = length + (3.0 * m.y + 2.0 * m.x) / (2.0 * m.x) * expansion * friction;
    var kept = shear * (1.0 - max(slip, 0.0) / length) + mean;
    if expansion >= 0.0 {
        kept = vec3(p.cohesion);
    }
    return two_point(point.f, exp(kept));
}

fn stress(point: Point, p: Parameters) -> mat3x3<f32> {
    let m = lame(p.young, p.poisson);
    let strain = log(stretches(point.f));
    return left(point.f, 2.0 * m.x * strain + m.y * (strain.x + strain.y + strain.z));
}

fn wave_speed(p: Parameters, density: f32) -> f32 {
    let m = lame(p.young, p.poisson);
    return sqrt((m.y + 2.0 * m.x) / density);
}
