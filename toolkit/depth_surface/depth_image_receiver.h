// Hands surfaces of depth images to frames, without a lock. Whole surfaces take turns.
#pragma once

#include <cstddef>
#include <memory>

#include <palpate/depth_stream.h>
#include <palpate/geometry.h>
#include <palpate/triple_buffer.h>
#include "toolkit/depth_surface/depth_fusion.h"
#include "toolkit/depth_surface/depth_sheets.h"
#include "toolkit/render/depth_camera.h"

namespace palpate::depth_surface {

/// Edge of the window around the HIP that can be felt first, in pixels.
inline constexpr int kFirstWindow = 128;

/// receive() and forget_frames() belong to one thread, newest() and sheets() to another.
class DepthImageReceiver final : public stream::DepthReceiver {
 public:
  /// `local_from_world`: of the HIP, whose local frame is the images' world.
  DepthImageReceiver(const stream::DepthCamera& camera, const geometry::RigidTransform& local_from_world);

  [[nodiscard]] stream::ReceiveReport receive(const stream::DepthFrame& frame,
                                              const Vec3& hip_mm) noexcept override;
  void forget_frames() noexcept override;

  /// Takes the newest surface, wait-free in O(1). True if it is newer than the last.
  bool newest() noexcept { return published_.acquire(); }
  [[nodiscard]] const DepthSheets& sheets() const noexcept { return published_.front(); }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  void publish() noexcept;

  stream::DepthCamera camera_;
  geometry::RigidTransform local_from_world_;
  render::FrameGate gate_;
  DepthFusion fusion_;
  DepthSheets newest_;  ///< what is published next
  TripleBuffer<DepthSheets> published_;
};

}  // namespace palpate::depth_surface
