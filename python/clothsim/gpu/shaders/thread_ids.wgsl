// Every invocation writes who it is, at the place that the stages of a step have for its point.
@compute @workgroup_size(group_size, group_size, 1)
fn thread_ids(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) thread: vec3<u32>,
    @builtin(global_invocation_id) dispatch: vec3<u32>,
) {
    if (!inside(dispatch)) {
        return;
    }
    let index = place(dispatch);
    let at = 7u * index;
    atomicStore(&results[at], group.x);
    atomicStore(&results[at + 1u], group.y);
    atomicStore(&results[at + 2u], thread.x);
    atomicStore(&results[at + 3u], thread.y);
    atomicStore(&results[at + 4u], dispatch.x);
    atomicStore(&results[at + 5u], dispatch.y);
    atomicStore(&results[at + 6u], index);
}
