// A camera that looks at a simulated scene, with the errors of a real one, all from one seed: the truth is
// known. Frames come as fast as they are asked for; their times say when they would have come.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/stream/simulated_scene.h"
#include "toolkit/stream/stock_scene.h"

namespace palpate::stream {

/// Where the camera is at a time.
using CameraPath = std::function<geometry::RigidTransform(double t_s)>;

/// The path, where the camera is within no model. Frames are the same for any number of threads.
[[nodiscard]] std::unique_ptr<DepthSource> make_simulated_camera(std::unique_ptr<SimulatedScene> scene,
                                                                 const DepthCamera& camera, CameraPath path,
                                                                 const SimulatedSensor& simulated,
                                                                 std::string name, int threads = 0);

/// The camera of a stock scene, at rest.
[[nodiscard]] Result<std::unique_ptr<DepthSource>> simulated_camera_of(StockScene stock, std::string name);
/// A stock scene with its options, as "wall:noise_mm=1".
[[nodiscard]] Result<std::unique_ptr<DepthSource>> open_simulated_camera(const std::string& spec);

}  // namespace palpate::stream
