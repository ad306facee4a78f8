// Responses in float32, for adapters without float64. A point is taken relative to the centre first, both with their low
// parts. So a response errs by units in the last place of the radius, not of the coordinates.
fn between(a: vec3<f32>, a_low: vec3<f32>, b: vec3<f32>, b_low: vec3<f32>) -> vec3<f32> {
    return keep_all(a - b) + (a_low - b_low);
}

fn position_from(body: Body, contact: Contact) -> vec3<f32> {
    return between(body.position, body.position_low, contact.center, contact.center_low);
}

// Way of a point in the sphere's frame, as the difference of two short ways.
fn way(body: Body, before: Body, contact: Contact, start: Contact) -> vec3<f32> {
    return between(body.position, body.position_low, before.position, before.position_low) -
        between(contact.center, contact.center_low, start.center, start.center_low);
}

fn velocity_of(body: Body) -> vec3<f32> { return body.velocity; }

// center + on_surface with its rounding error (Knuth's two-sum).
fn moved_body(body: Body, contact: Contact, responded: Response) -> Body {
    var result = body;
    if (responded.moved) {
        let sum = keep_all(contact.center + responded.on_surface);
        let part = keep_all(sum - contact.center);
        result.position = sum;
        result.position_low = (contact.center - keep_all(sum - part)) + (responded.on_surface - part) + contact.center_low;
    }
    if (any(responded.velocity != body.velocity)) {
        result.velocity = responded.velocity;
        result.velocity_low = vec3<f32>(0.0);
    }
    return result;
}
