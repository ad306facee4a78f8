// Responses in float32, for adapters without float64. A point is taken relative to the place on the sphere first, both with their low
// parts. So a response errs by units in the last place of the radius, not of the coordinates.
fn between(a: vec3<f32>, a_low: vec3<f32>, b: vec3<f32>, b_low: vec3<f32>) -> vec3<f32> {
    return keep_all(a - b) + (a_low - b_low);
}

fn position_from(body: Body, contact: Contact) -> vec3<f32> {
    return between(body.position, body.position_low, contact.place, contact.place_low);
}

// Way of a point in the sphere's frame, as the difference of two short ways.
fn way(body: Body, before: Body, contact: Contact, start: Contact) -> vec3<f32> {
    return between(body.position, body.position_low, before.position, before.position_low) -
        between(contact.place, contact.place_low, start.place, start.place_low);
}

fn velocity_of(body: Body) -> vec3<f32> { return body.velocity; }

// place + d with its rounding error (Knuth's two-sum).
fn moved_body(body: Body, contact: Contact, responded: Response) -> Body {
    var result = body;
    if (responded.moved) {
        let sum = keep_all(contact.place + responded.d);
        let part = keep_all(sum - contact.place);
        result.position = sum;
        result.position_low = (contact.place - keep_all(sum - part)) + (responded.d - part) + contact.place_low;
    }
    if (any(responded.velocity != body.velocity)) {
        result.velocity = responded.velocity;
        result.velocity_low = vec3<f32>(0.0);
    }
    return result;
}
