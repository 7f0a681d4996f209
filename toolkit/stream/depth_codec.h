// Depth images as bytes and back, without loss, for recordings. A float's bits grow with its value, so the
// difference to the pixel on the left is small on a surface; its bytes are gathered by weight and packed.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/result.h>

namespace palpate::stream {

/// The camera of a stream, in front of its frames.
inline constexpr std::size_t kCameraBytes = 4 + 2 * 4 + 12 * 8 + 4;
[[nodiscard]] std::vector<std::byte> encode_camera(const DepthCamera& camera);
/// Sides of 1 to 8192 pixels, positive focal lengths and period, all numbers finite; else an Error.
[[nodiscard]] Result<DepthCamera> decode_camera(std::span<const std::byte> bytes);

/// Encodes and decodes the frames of one stream. Keeps its memory from frame to frame. Not thread-safe.
class DepthCodec {
 public:
  /// `camera` tells the width of a row; frames with fewer or more depths than pixels are kept as they are.
  explicit DepthCodec(const DepthCamera& camera);
  ~DepthCodec();
  DepthCodec(const DepthCodec&) = delete;
  DepthCodec& operator=(const DepthCodec&) = delete;

  /// 640 x 480 depths take 3 to 8 ms. The bytes are valid until the next call. An Error beyond four times the
  /// camera's pixels.
  [[nodiscard]] Result<std::span<const std::byte>> encode(const DepthFrame& frame);
  /// Damaged bytes are an Error and leave `frame` unspecified. Memory is bounded by the camera's pixels.
  [[nodiscard]] Status decode(std::span<const std::byte> bytes, DepthFrame& frame);

 private:
  struct Packer;
  void gather(std::span<const float> depths);
  void scatter(std::span<float> depths) const;

  std::size_t width_;
  std::size_t most_depths_;
  std::vector<std::uint32_t> codes_;
  std::vector<std::uint8_t> planes_;
  std::vector<std::byte> packed_;
  std::unique_ptr<Packer> packer_;
};

}  // namespace palpate::stream
