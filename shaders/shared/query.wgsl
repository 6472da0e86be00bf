// The device's own way: a ray query through its tree over boxes, each around one pair of triangles. What the query
// reports is judged here as it is at a leaf of the other trees; when a hit is certain the query is told how far it has
// to look.
//
// Vulkan promises a candidate for every box that holds a point of the ray within its interval, and allows more ("Ray
// Intersection Candidate Determination"). It gives no bound on the rounding of the test, so the boxes are pushed out,
// by QUERY_MARGIN times the scene's largest coordinate (`trace/gpu/flatten/boxes.rs` derives the margin), and
// rays from so far away that the margin would not do are UNCERTAIN: see `prepare`.

fn traverse(ray: PreparedRay, found: ptr<function, Found>) {
    var nowhere: Member;
    var query: ray_query;
    rayQueryInitialize(
        &query,
        boxes,
        RayDesc(RAY_FLAG_NONE, 0xffu, ray.t_min, ray.t_max, ray.origin, ray.slanted),
    );
    var is_told = false;
    loop {
        if !rayQueryProceed(&query) {
            return;
        }
        let index = rayQueryGetCandidateIntersection(&query).primitive_index;
        let reference = LEAF | index | select(0u, MASKED, index >= FIRST_MASKED);
        if through_leaf(ray, reference, nowhere, found) {
            return;
        }
        // Once only: a second time, naga 30.0.1 compares with the candidate's distance instead of the committed one,
        // and a box has no candidate distance.
        let limit = limit_of(found);
        if !is_told && limit < ray.t_max {
            rayQueryGenerateIntersection(&query, limit);
            is_told = true;
        }
    }
}
