//! Is the visibility graph right, and does it get there with few rays?

#[path = "support/rooms.rs"]
mod rooms;

use luxgraph::observer::Silent;
use luxgraph::points::facing::face_each_other;
use luxgraph::tracers::brute_force::BruteForce;
use luxgraph::tracers::{RayTracer, Segment};
use luxgraph::visibility::VisibilityGraph;

#[test]
fn timing() {
    let geometry = rooms::furnished_room(true);
    let points = rooms::sample(&geometry, 0.04, 5);
    println!("{} surfaces {} points", geometry.surfaces.len(), points.len());
    let tracer = BruteForce::new(&geometry);
    let graph = VisibilityGraph::build(&geometry, &points, &tracer, &Silent).unwrap();
    println!("{:#?} {}", graph.stats, graph.memory_bytes());
}

#[test]
fn agrees() {
    let geometry = rooms::furnished_room(false);
    let points = rooms::sample(&geometry, 0.2, 4);
    let tracer = BruteForce::new(&geometry);
    let graph = VisibilityGraph::build(&geometry, &points, &tracer, &Silent).unwrap();
    println!("{} surfaces {} points", geometry.surfaces.len(), points.len());
    println!("{:#?} {}", graph.stats, graph.memory_bytes());
    let mut bad = 0;
    let mut facing = 0;
    for i in 0..points.len() {
        for j in i+1..points.len() {
            if face_each_other(&geometry, &points, i, j) {
                facing += 1;
                let seg = Segment { from: points.position[i], to: points.position[j] };
                let free = tracer.blocker(&seg).is_none();
                if free != graph.unblocked(i, j) { bad += 1; 
                    println!("{i} {j} {free} {:?} {:?} {:?}", tracer.blocker(&seg), points.surface[i], points.surface[j]);
                }
            }
        }
    }
    println!("facing {facing} bad {bad}");
}
