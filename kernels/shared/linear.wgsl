// Numbers of workgroups and invocations. A dispatch of more than 65535 workgroups is spread over three axes; the last
// rows of it may be longer than the work, so every kernel compares its number with the size of the work.
const WORKGROUP: u32 = 256u;

fn linear_group(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return (group.z * groups.y + group.y) * groups.x + group.x;
}
