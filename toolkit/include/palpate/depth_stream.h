// Depth images that arrive in time: the camera, a frame, a source of frames and who receives them.
//
// Lengths in mm, times in s, pixels with their centres at whole numbers. The camera's axes are x to the
// right, y down, z forward; a depth is the z of a point, not its distance.
//
// First:
//   palpate::stream::DepthReceiver* receiver = renderer->depth_receiver();  // of depth-image
//   if (receiver != nullptr) (void)receiver->receive(palpate::stream::DepthFrame{}, hip_mm);
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::stream {

/// Pinhole camera with the lens of Brown and Conrady, and what its depths err.
struct DepthCamera {
  int width = 640;
  int height = 480;
  double fx_px = 525.0, fy_px = 525.0;
  double cx_px = 319.5, cy_px = 239.5;
  std::array<double, 5> distortion{};  ///< k1, k2, p1, p2, k3; all 0: none
  double period_s = 1.0 / 30.0;        ///< between two frames
  /// Standard deviation of a depth z: noise_mm + noise_per_mm z^2, as of structured light.
  double noise_mm = 0.0;
  double noise_per_mm = 0.0;

  [[nodiscard]] std::size_t pixels() const noexcept {
    return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  }
  [[nodiscard]] double noise_at_mm(double z_mm) const noexcept {
    return noise_mm + noise_per_mm * z_mm * z_mm;
  }
};

/// One image. Its vector keeps its memory from frame to frame.
struct DepthFrame {
  std::uint64_t number = 0;  ///< of the camera, from 0; rising by 1 where none is lost
  double captured_s = 0.0;   ///< light
  double arrived_s = 0.0;    ///< at this program, never before it was captured
  geometry::RigidTransform world_from_camera;
  std::vector<float> depth_mm;  ///< row by row, pixels() of them; 0 or not finite: not measured
};

/// Frames one after another. Called by one thread.
class DepthSource {
 public:
  DepthSource() = default;
  DepthSource(const DepthSource&) = delete;
  DepthSource& operator=(const DepthSource&) = delete;
  virtual ~DepthSource() = default;

  [[nodiscard]] virtual const DepthCamera& camera() const noexcept = 0;
  /// The next frame, or false at the end. Times rise. A camera waits for its next image; files do not wait:
  /// who plays them waits until `arrived_s`.
  /// @error a frame that cannot be read: names the file; the next call goes on with the one after it.
  [[nodiscard]] virtual Result<bool> next(DepthFrame& frame) = 0;
  /// Starts again with the first frame; a camera goes on.
  [[nodiscard]] virtual Status restart() = 0;
  /// Frames in all, or 0 where that is not known.
  [[nodiscard]] virtual std::uint64_t frames() const noexcept { return 0; }
  [[nodiscard]] virtual std::string describe() const = 0;
};

enum class FrameFate : std::uint8_t {
  kTaken,
  kRepeated,   ///< same number or same time as one before
  kLate,       ///< older than one before
  kTruncated,  ///< fewer or more depths than pixels, a pose that is none, or a time that is not finite
  kFailed,     ///< no memory for its surface: the last one stays, or the window of this one
};

struct ReceiveReport {
  FrameFate fate = FrameFate::kTaken;
  double window_ms = 0.0;  ///< until the surface around the HIP could be felt
  double whole_ms = 0.0;   ///< until the whole image could be felt
};

/// Interface of a renderer of streams besides HapticRenderer, from its depth_receiver().
class DepthReceiver {
 public:
  DepthReceiver() = default;
  DepthReceiver(const DepthReceiver&) = delete;
  DepthReceiver& operator=(const DepthReceiver&) = delete;
  virtual ~DepthReceiver() = default;

  /// Makes the surface of a frame and publishes it, the window around the HIP first. One thread at a time
  /// calls it, never the servo thread, which may be in step() meanwhile and takes what was published without
  /// a lock. A frame that is no use (see FrameFate) changes nothing.
  [[nodiscard]] virtual ReceiveReport receive(const DepthFrame& frame, const Vec3& hip_mm) noexcept = 0;
  /// Forgets every frame but the scene's own cloud, before a replay begins. No step() may run meanwhile.
  virtual void forget_frames() noexcept = 0;
};

}  // namespace palpate::stream
