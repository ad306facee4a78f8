// Ids of every invocation, written where the stages of a step keep its point.
@compute @workgroup_size(group_size, group_size, 1)
fn thread_ids(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(global_invocation_id) dispatch: vec3<u32>,
) {
    if (!inside(dispatch)) { return; }
    let index = place(dispatch);
    var ids = array<u32, 7>(group.x, group.y, thread.x, thread.y, dispatch.x, dispatch.y, index);
    for (var k = 0u; k < 7u; k++) { atomicStore(&results[7u * index + k], ids[k]); }
}
