//! The bridge to ROS 2 knows every channel of the drawings with its type.

use messages::CHANNELS;
use std::path::Path;

#[test]
fn the_bridge_to_ros_2_has_every_drawing() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scripts/python/ros2_bridge.py");
    let script = std::fs::read_to_string(path).unwrap();
    let drawn: Vec<_> = CHANNELS.iter().filter(|channel| channel.publisher == "visualization").collect();
    assert!(drawn.len() >= 8);
    for channel in drawn {
        let name = channel.type_name.unwrap()();
        let parts: Vec<&str> = name.split('/').collect();
        let row = format!("\"{}\": \"{}/msg/{}\",", channel.pattern.trim_end_matches('*'), parts[0], parts[1]);
        assert!(script.contains(&row), "ros2_bridge.py lacks {row}");
    }
}
