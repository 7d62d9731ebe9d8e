// What every kernel of a substep knows. Twin of src/physics/gpu/words.rs.
#import "shared/linear.wgsl"

struct Substep {
    particles: u32,
    // number of the substep, from 0
    step: u32,
    // nodes that there is room for
    capacity: u32,
    // how many obstacles, and where those of this substep begin in their table
    obstacles: u32,
    first_obstacle: u32,
    // the particles of one material
    first: u32,
    count: u32,
    frame: u32,
    dx: f32,
    inverse_dx: f32,
    dt: f32,
    // dt V0 4/dx²
    stress_scale: f32,
    // dt g
    kick: vec3<f32>,
    least_mass: f32,
    // where particles may be, and how fast
    low: vec3<f32>,
    speed: f32,
    high: vec3<f32>,
    // 1: the cotangents of gravity and friction are wanted
    tracked: u32,
}

@group(0) @binding(0) var<uniform> substep: Substep;

// Where the parts of a state begin: 24 numbers for each particle and history after them, one array for each number.
const V: u32 = 3u;
const C: u32 = 6u;
const F: u32 = 15u;

// The place of a number of a particle in a state.
fn place(component: u32, particle: u32) -> u32 {
    return component * substep.particles + particle;
}

// More than any number of faces, substeps or particles.
const NONE: u32 = 0xffffffffu;

fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}
