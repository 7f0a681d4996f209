// Fuzzes what streams of depth images are read from: an Error that says what is wrong, or sound values, in
// bounded memory. The first byte chooses what the rest is read as.
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <vector>

#include "tests/fuzz/must.h"
#include "toolkit/stream/camera_files.h"
#include "toolkit/stream/depth_codec.h"

namespace {

using namespace palpate;
using namespace palpate::stream;

template <class R>
bool read(const R& result) {
  must(result.ok() || !result.error().what.empty());
  return result.ok();
}

void check(const geometry::RigidTransform& pose) {
  must(is_finite(pose.translation_mm));
  must(std::abs(pose.rotation.norm() - 1.0) < 1e-9);
}

void check(const DepthCamera& camera) {
  must(camera.width >= 1 && camera.height >= 1);
  must(camera.fx_px > 0.0 && camera.fy_px > 0.0 && std::isfinite(camera.cx_px + camera.cy_px));
}

/// What was read is written and read again as the same.
void read_frame(std::span<const std::byte> bytes) {
  DepthCamera camera;
  camera.width = 16;
  camera.height = 12;
  DepthCodec codec(camera);
  DepthFrame frame, again;
  if (!read(codec.decode(bytes, frame))) return;
  must(frame.depth_mm.size() <= 4 * camera.pixels());
  const auto written = codec.encode(frame);
  must(written.ok());
  const std::vector<std::byte> copy(written->begin(), written->end());
  must(codec.decode(copy, again).ok());
  must(again.depth_mm.size() == frame.depth_mm.size());
  must(frame.depth_mm.empty() ||
       std::memcmp(again.depth_mm.data(), frame.depth_mm.data(), frame.depth_mm.size() * sizeof(float)) == 0);
}

void read_image(std::span<const std::byte> bytes) {
  DepthImage image;
  if (read(read_depth_png(bytes, {}, image))) {
    must(image.counts.size() == std::size_t{image.width} * image.height);
    must(image.width <= kMaxImageSide && image.height <= kMaxImageSide);
  }
  if (read(read_depth_png(bytes, {16, 12}, image))) must(image.width == 16 && image.height == 12);
}

void read_texts(std::uint8_t kind, std::string_view text) {
  if (kind == 3) {
    const auto poses = parse_timed_poses(text);
    if (!read(poses)) return;
    for (const TimedPose& pose : *poses) check(pose.world_from_camera);
    for (const TimedPose& pose : *poses)
      if (const auto at = pose_at(*poses, pose.t_s + 0.01)) check(*at);
  } else if (kind == 4) {
    const auto files = parse_timed_files(text);
    if (!read(files)) return;
    for (const TimedFile& file : *files) must(std::isfinite(file.t_s) && !file.file.empty());
  } else if (kind == 5) {
    const auto poses = parse_pose_log(text);
    if (!read(poses)) return;
    for (const geometry::RigidTransform& pose : *poses) check(pose);
  } else if (kind == 6) {
    const auto pose = parse_pose(text);
    if (read(pose)) check(*pose);
  } else {
    DepthCamera camera;
    if (read(parse_intrinsics(text, camera))) check(camera);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  constexpr std::uint8_t kKinds = 8;
  const std::uint8_t kind = data[0] % kKinds;
  const std::span<const std::byte> rest = std::as_bytes(std::span(data, size)).subspan(1);
  if (kind == 0) {
    read_frame(rest);
  } else if (kind == 1) {
    if (const auto camera = decode_camera(rest); read(camera)) check(*camera);
  } else if (kind == 2) {
    read_image(rest);
  } else {
    read_texts(kind, {reinterpret_cast<const char*>(rest.data()), rest.size()});
  }
  return 0;
}
