// The adjoint of grid.wgsl. Scatters again what particles scattered and, after it in `records`, what the adjoint of their
// gather scatters. Nodes receive [velocity, mass] and, from number `capacity` on, the cotangents of [momentum, mass]; the
// cotangents of gravity and friction add up by workgroup.
#import "shared/sum_of_group.wgsl"

@group(0) @binding(2) var<storage, read_write> grid: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> counts: array<u32>;
@group(0) @binding(8) var<storage, read_write> on_world: array<f32>;

// The host reads it from here.
const MOST_OBSTACLES: u32 = 32u;

// of the coefficients of friction, one for each obstacle
var<private> on_friction: array<f32, MOST_OBSTACLES>;

// The cotangent of the velocity before contact with one face.
fn touch_vjp(way: Walk, g: vec3<f32>) -> vec3<f32> {
    let kind = obstacles[row_of(way.obstacle)];
    let n = way.normal;
    switch u32(kind.z) {
        case 0u: { return vec3<f32>(0.0); }
        case 1u: { return g - n * dot(n, g); }
        case 2u: { return select(g, g - n * dot(n, g), dot(n, way.v - way.wall) < 0.0); }
        default: {
            let slide = slide_of(kind.w, n, way.v - way.wall);
            switch slide.kind {
                case 0u: { return g; }
                case 1u: { return vec3<f32>(0.0); }
                default: {
                    let along = dot(g, slide.direction);
                    on_friction[min(way.obstacle, MOST_OBSTACLES - 1u)] += slide.impact * along;
                    let on_along = g + kind.w * slide.impact / slide.speed * (g - slide.direction * along);
                    return on_along - n * (dot(n, on_along) - kind.w * along);
                }
            }
        }
    }
}

@compute @workgroup_size(WORKGROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let number_of_group = linear_group(group, groups);
    let i = number_of_group * WORKGROUP + local;
    let node_grid = node_grid_now();
    var on_free = vec3<f32>(0.0);
    if i < substep.capacity && node_grid.sound && node_grid.fits {
        counts[i] = 0u;
        let number = i32(i);
        let row = number / node_grid.shape.z;
        let node = vec3<i32>(row / node_grid.shape.y, row % node_grid.shape.y, number % node_grid.shape.z);
        if node.x < node_grid.shape.x {
            let sum = scattered(node_grid, node, 0u);
            var v = vec3<f32>(0.0);
            var on_sum = vec4<f32>(0.0);
            if sum.w > substep.least_mass {
                let x = vec3<f32>(node + node_grid.low) * substep.dx;
                let free = sum.xyz / sum.w + substep.kick;
                let way = walk(x, free, NONE);
                v = way.v;
                on_free = scattered(node_grid, node, substep.particles).xyz;
                for (var face = way.faces; face > 0u; face--) {
                    on_free = touch_vjp(walk(x, free, face - 1u), on_free);
                }
                on_sum = vec4<f32>(on_free / sum.w, -dot(on_free, sum.xyz) / (sum.w * sum.w));
            }
            grid[i] = vec4<f32>(v, sum.w);
            grid[substep.capacity + i] = on_sum;
        }
    }
    if substep.tracked != 0u {
        let width = 3u + substep.obstacles;
        for (var k = 0u; k < width; k++) {
            var part = 0.0;
            if k < 3u {
                part = substep.dt * on_free[k];
            } else {
                part = on_friction[min(k - 3u, MOST_OBSTACLES - 1u)];
            }
            let sum = sum_of_group(local, part);
            if local == 0u && number_of_group * WORKGROUP < substep.capacity {
                on_world[number_of_group * width + k] += sum;
            }
        }
    }
}
