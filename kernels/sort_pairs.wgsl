// Sorts pairs of words, by the first word and then by the second: a bitonic network. No atomics, the same order always.
//
// Runs of `run` pairs are sorted, up and down by turns, from two sorted halves. Within blocks that fit workgroup memory a
// kernel makes all comparisons (`blocks` from single pairs on, `tails` the last ones of a longer run); between them `steps`
// makes those at one distance. Places beyond the list hold the largest pair.
#import "shared/linear.wgsl"

// Pairs of one block: two for each invocation. The host reads it from here.
const BLOCK: u32 = 512u;

struct Sizes {
    // pairs given, and pairs after filling up to a power of two
    count: u32,
    padded: u32,
    run: u32,
    distance: u32,
}

@group(0) @binding(0) var<uniform> sizes: Sizes;
@group(0) @binding(1) var<storage, read_write> y: array<u32>;
@group(0) @binding(2) var<storage, read> x: array<u32>;

var<workgroup> firsts: array<u32, BLOCK>;
var<workgroup> seconds: array<u32, BLOCK>;

fn load(place: u32, slot: u32) {
    firsts[slot] = 0xffffffffu;
    seconds[slot] = 0xffffffffu;
    if place < sizes.count {
        firsts[slot] = x[2u * place];
        seconds[slot] = x[2u * place + 1u];
    }
}

// Whether pair a comes after pair b.
fn after(a: vec2<u32>, b: vec2<u32>) -> bool {
    return a.x > b.x || (a.x == b.x && a.y > b.y);
}

// Orders the pairs of a block at a distance; `start` is the place of its first.
fn exchange(local: u32, distance: u32, run: u32, start: u32) {
    let low = local / distance * distance * 2u + local % distance;
    let high = low + distance;
    let a = vec2<u32>(firsts[low], seconds[low]);
    let b = vec2<u32>(firsts[high], seconds[high]);
    let upwards = ((start + low) & run) == 0u;
    if after(a, b) == upwards {
        firsts[low] = b.x;
        seconds[low] = b.y;
        firsts[high] = a.x;
        seconds[high] = a.y;
    }
}

fn store(place: u32, slot: u32) {
    y[2u * place] = firsts[slot];
    y[2u * place + 1u] = seconds[slot];
}

@compute @workgroup_size(WORKGROUP)
fn blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let start = linear_group(group, groups) * BLOCK;
    if start >= sizes.padded {
        return;
    }
    load(start + local, local);
    load(start + local + WORKGROUP, local + WORKGROUP);
    for (var run = 2u; run <= BLOCK; run *= 2u) {
        for (var distance = run / 2u; distance > 0u; distance /= 2u) {
            workgroupBarrier();
            exchange(local, distance, run, start);
        }
    }
    workgroupBarrier();
    store(start + local, local);
    store(start + local + WORKGROUP, local + WORKGROUP);
}

@compute @workgroup_size(WORKGROUP)
fn steps(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let place = linear_group(group, groups) * WORKGROUP + local;
    if place >= sizes.padded {
        return;
    }
    let other = place ^ sizes.distance;
    let here = vec2<u32>(x[2u * place], x[2u * place + 1u]);
    let there = vec2<u32>(x[2u * other], x[2u * other + 1u]);
    // the lower place of a run that goes upwards takes the smaller pair
    let smaller = ((place & sizes.run) == 0u) == (place < other);
    let kept = select(here, there, after(here, there) == smaller);
    y[2u * place] = kept.x;
    y[2u * place + 1u] = kept.y;
}

@compute @workgroup_size(WORKGROUP)
fn tails(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let start = linear_group(group, groups) * BLOCK;
    if start >= sizes.padded {
        return;
    }
    load(start + local, local);
    load(start + local + WORKGROUP, local + WORKGROUP);
    for (var distance = BLOCK / 2u; distance > 0u; distance /= 2u) {
        workgroupBarrier();
        exchange(local, distance, sizes.run, start);
    }
    workgroupBarrier();
    store(start + local, local);
    store(start + local + WORKGROUP, local + WORKGROUP);
}
