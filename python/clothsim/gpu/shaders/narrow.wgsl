// Responses in float32, for adapters without float64. A point is taken relative to the centre first, both with their low
// parts. So a response errs by units in the last place of the radius, not of the coordinates.
fn keep_all(a: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(keep(a.x), keep(a.y), keep(a.z));
}

fn position_from(body: Body, contact: Contact) -> vec3<f32> {
    return keep_all(body.position - contact.center) + (body.position_low - contact.center_low);
}

fn velocity_of(body: Body) -> vec3<f32> {
    return body.velocity;
}

// center + on_surface with its rounding error (Knuth's two-sum).
fn moved_body(body: Body, contact: Contact, responded: Response) -> Body {
    var result = body;
    if (responded.moved) {
        let a = contact.center;
        let b = responded.on_surface;
        let sum = keep_all(a + b);
        let b_part = keep_all(sum - a);
        let a_part = keep_all(sum - b_part);
        result.position = sum;
        result.position_low = (a - a_part) + (b - b_part) + contact.center_low;
    }
    if (any(responded.velocity != body.velocity)) {
        result.velocity = responded.velocity;
        result.velocity_low = vec3<f32>(0.0);
    }
    return result;
}
