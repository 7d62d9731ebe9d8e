// What obstacles do to the velocity of a node. Twin of src/physics/contact.rs; the table comes from
// src/physics/gpu/obstacles.rs, nine rows for each obstacle.
@group(0) @binding(7) var<storage, read> obstacles: array<vec4<f32>>;

const ROWS: u32 = 9u;
// The faces that a node touches; more than one in a corner of a container.
struct Faces {
    normals: array<vec3<f32>, 3>,
    count: u32,
}

// How far the obstacles have been gone through, and the face that comes next.
struct Walk {
    // velocity after the faces so far
    v: vec3<f32>,
    faces: u32,
    obstacle: u32,
    normal: vec3<f32>,
    wall: vec3<f32>,
}

// Coulomb friction: 0 free, 1 stuck, 2 sliding with this velocity of impact, direction and speed.
struct Slide {
    kind: u32,
    impact: f32,
    direction: vec3<f32>,
    speed: f32,
}

fn row_of(obstacle: u32) -> u32 {
    return (substep.first_obstacle + obstacle) * ROWS;
}

fn faces_of(row: u32, x: vec3<f32>) -> Faces {
    let kind = obstacles[row];
    let a = obstacles[row + 1u];
    let b = obstacles[row + 2u];
    let container = kind.y != 0.0;
    let shifted = x - obstacles[row + 3u].xyz;
    var turn = array<vec3<f32>, 3>(obstacles[row + 6u].xyz, obstacles[row + 7u].xyz, obstacles[row + 8u].xyz);
    // the transposed rotation leads back to where the region is described
    let local = turn[0] * shifted.x + turn[1] * shifted.y + turn[2] * shifted.z - a.xyz;
    var found: Faces;
    switch u32(kind.x) {
        // plane: point, normal
        case 0u: {
            let height = dot(local, b.xyz);
            if !container && height <= 1e-6 {
                found.normals[0] = b.xyz;
                found.count = 1u;
            } else if container && height >= -1e-6 {
                found.normals[0] = -b.xyz;
                found.count = 1u;
            }
        }
        // cylinder: start and radius, axis and length
        case 1u: {
            let along = dot(local, b.xyz);
            let radial = local - along * b.xyz;
            let distance = sqrt(dot(radial, radial) + 1e-8);
            if !container {
                if along >= 0.0 && along <= b.w && distance <= a.w {
                    found.normals[0] = radial / distance;
                    found.count = 1u;
                }
            } else {
                if distance >= a.w {
                    found.normals[0] = -radial / distance;
                    found.count = 1u;
                }
                if along <= 0.0 {
                    found.normals[found.count] = b.xyz;
                    found.count++;
                } else if along >= b.w {
                    found.normals[found.count] = -b.xyz;
                    found.count++;
                }
            }
        }
        // ball: centre and radius
        case 2u: {
            let distance = sqrt(dot(local, local) + 1e-8);
            if (!container && distance <= a.w) || (container && distance >= a.w) {
                found.normals[0] = select(local, -local, container) / distance;
                found.count = 1u;
            }
        }
        // box: centre, half of its edges
        default: {
            let depth = b.xyz - abs(local);
            let outwards = select(vec3<f32>(-1.0), vec3<f32>(1.0), local >= vec3<f32>(0.0));
            if container {
                for (var axis = 0u; axis < 3u; axis++) {
                    if depth[axis] <= 0.0 {
                        var normal = vec3<f32>(0.0);
                        normal[axis] = -outwards[axis];
                        found.normals[found.count] = normal;
                        found.count++;
                    }
                }
            } else if all(depth >= vec3<f32>(0.0)) {
                var nearest = 0u;
                for (var axis = 1u; axis < 3u; axis++) {
                    if depth[axis] < depth[nearest] {
                        nearest = axis;
                    }
                }
                var normal = vec3<f32>(0.0);
                normal[nearest] = outwards[nearest];
                found.normals[0] = normal;
                found.count = 1u;
            }
        }
    }
    for (var k = 0u; k < found.count; k++) {
        let n = found.normals[k];
        found.normals[k] = vec3<f32>(dot(turn[0], n), dot(turn[1], n), dot(turn[2], n));
    }
    return found;
}

// The velocity of an obstacle at a point.
fn wall_of(row: u32, x: vec3<f32>) -> vec3<f32> {
    return obstacles[row + 4u].xyz + cross(obstacles[row + 5u].xyz, x - obstacles[row + 3u].xyz);
}

fn slide_of(friction: f32, n: vec3<f32>, relative: vec3<f32>) -> Slide {
    var slide: Slide;
    slide.impact = dot(n, relative);
    if slide.impact >= 0.0 {
        return slide;
    }
    let along = relative - n * slide.impact;
    slide.speed = sqrt(dot(along, along));
    slide.kind = 1u;
    if !(slide.speed <= -friction * slide.impact) {
        slide.kind = 2u;
        slide.direction = along / slide.speed;
    }
    return slide;
}

// The velocity after contact with one face.
fn touch(row: u32, n: vec3<f32>, wall: vec3<f32>, v: vec3<f32>) -> vec3<f32> {
    let kind = obstacles[row];
    let normal_speed = dot(n, v - wall);
    switch u32(kind.z) {
        case 0u: { return wall; }
        case 1u: { return v - n * normal_speed; }
        // NaN passes on
        case 2u: { return select(v - n * normal_speed, v, normal_speed >= 0.0); }
        default: {
            let slide = slide_of(kind.w, n, v - wall);
            switch slide.kind {
                case 0u: { return v; }
                case 1u: { return wall; }
                default: { return wall + slide.direction * (slide.speed + kind.w * slide.impact); }
            }
        }
    }
}

// Goes through the faces that a node touches, in order; stops before the face with this number.
fn walk(x: vec3<f32>, v: vec3<f32>, before: u32) -> Walk {
    var way: Walk;
    way.v = v;
    for (var obstacle = 0u; obstacle < substep.obstacles; obstacle++) {
        let row = row_of(obstacle);
        let faces = faces_of(row, x);
        if faces.count == 0u {
            continue;
        }
        way.obstacle = obstacle;
        way.wall = wall_of(row, x);
        for (var k = 0u; k < faces.count; k++) {
            way.normal = faces.normals[k];
            if way.faces == before {
                return way;
            }
            way.v = touch(row, way.normal, way.wall, way.v);
            way.faces++;
        }
    }
    return way;
}
