// Decodes depth images of PNG files and recordings, encodes the latter.
//
// A recording's images are coded without loss: a float's bits grow with its value, so the difference to the
// pixel on the left is small on a surface; its bytes are gathered by weight and packed. PNG files have one
// 16-bit grey channel. Hostile bytes are bounded before anything is allocated for them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include <palpate/depth_stream.h>
#include <palpate/result.h>

namespace palpate::stream {

/// Longest side of an image: four times that of the largest depth cameras, and 128 MB as counts.
inline constexpr std::uint32_t kMaxImageSide = 8192;

/// Counts of a camera, row by row. Its vector keeps its memory from image to image.
struct DepthImage {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::vector<std::uint16_t> counts;
};

/// Width and height that a file must have; 0: any up to kMaxImageSide.
struct ImageSize {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
};

/// Decodes a PNG file. Sizes are checked against `expected` and against what so many bytes can unpack to. An
/// Error names no file.
[[nodiscard]] Status read_depth_png(std::span<const std::byte> file, ImageSize expected, DepthImage& image);

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
