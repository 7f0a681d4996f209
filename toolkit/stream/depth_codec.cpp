#include "toolkit/stream/depth_codec.h"

#include <fmt/format.h>
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <csetjmp>
#include <cstring>

#include "toolkit/core/bytes.h"

namespace palpate::stream {

// ---- PNG files

namespace {

constexpr std::size_t kPngSignatureBytes = 8;
constexpr int kDepthBits = 16;
/// Deflate's best: a match of 258 bytes takes two bits.
constexpr std::uint64_t kMostDeflateRatio = 1032;
/// A recording's text chunks take some hundred bytes; longer ones are skipped unread.
constexpr png_alloc_size_t kMostChunkBytes = png_alloc_size_t{1} << 23;
constexpr int kMostKeptChunks = 16;

constexpr const char* kPngRemedy =
    "depth images are PNG files of one 16-bit grey channel: check or fetch it again";

/// State that libpng's callbacks reach. Plain data: libpng leaves by longjmp, which runs no destructor.
struct PngContext {
  const std::byte* at = nullptr;
  std::size_t left = 0;
  std::array<char, 128> message{};
};

void keep_message(png_structp png, png_const_charp message) {
  auto* const context = static_cast<PngContext*>(png_get_error_ptr(png));
  std::strncpy(context->message.data(), message, context->message.size() - 1);
  png_longjmp(png, 1);
}
void ignore_warning(png_structp, png_const_charp) {}

void take_bytes(png_structp png, png_bytep into, png_size_t bytes) {
  auto* const context = static_cast<PngContext*>(png_get_io_ptr(png));
  if (bytes > context->left) png_error(png, "the file ends too early");
  std::memcpy(into, context->at, bytes);
  context->at += bytes;
  context->left -= bytes;
}

/// libpng's two objects. Each step that calls libpng has a return point of its own and no destructors.
class PngReader {
 public:
  explicit PngReader(std::span<const std::byte> file) noexcept {
    context_.at = file.data();
    context_.left = file.size();
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, &context_, keep_message, ignore_warning);
    if (png_ != nullptr) info_ = png_create_info_struct(png_);
  }
  ~PngReader() { png_destroy_read_struct(&png_, &info_, nullptr); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;

  [[nodiscard]] bool header() noexcept {
    if (info_ == nullptr) return false;
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    png_set_read_fn(png_, &context_, take_bytes);
    png_set_user_limits(png_, kMaxImageSide, kMaxImageSide);
    png_set_chunk_malloc_max(png_, kMostChunkBytes);
    png_set_chunk_cache_max(png_, kMostKeptChunks);
    png_read_info(png_, info_);
    return true;
  }
  /// `counts` has room for the image. An interlaced one covers its rows once a pass.
  [[nodiscard]] bool pixels(std::uint16_t* counts) noexcept {
    if (setjmp(png_jmpbuf(png_)) != 0) return false;
    if constexpr (std::endian::native == std::endian::little) png_set_swap(png_);
    const int passes = png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    for (int pass = 0; pass < passes; ++pass)
      for (png_uint_32 row = 0; row < height(); ++row)
        png_read_row(png_, reinterpret_cast<png_bytep>(counts + std::size_t{row} * width()), nullptr);
    png_read_end(png_, nullptr);
    return true;
  }
  [[nodiscard]] png_uint_32 width() const noexcept { return png_get_image_width(png_, info_); }
  [[nodiscard]] png_uint_32 height() const noexcept { return png_get_image_height(png_, info_); }
  [[nodiscard]] bool is_depth() const noexcept {
    return png_get_color_type(png_, info_) == PNG_COLOR_TYPE_GRAY &&
           png_get_bit_depth(png_, info_) == kDepthBits;
  }
  [[nodiscard]] Error refused() const {
    return {fmt::format("the PNG image cannot be read: {}",
                        context_.message[0] != 0 ? context_.message.data() : "no memory is left"),
            kPngRemedy};
  }

 private:
  PngContext context_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

}  // namespace

Status read_depth_png(std::span<const std::byte> file, ImageSize expected, DepthImage& image) {
  if (file.size() < kPngSignatureBytes ||
      png_sig_cmp(reinterpret_cast<png_const_bytep>(file.data()), 0, kPngSignatureBytes) != 0)
    return Error{"is no PNG file", kPngRemedy};
  PngReader reader(file);
  if (!reader.header()) return reader.refused();
  if (!reader.is_depth()) return Error{"the PNG image has no depths: it is not 16-bit grey", kPngRemedy};
  const std::uint32_t width = reader.width(), height = reader.height();
  if ((expected.width != 0 && expected.width != width) || (expected.height != 0 && expected.height != height))
    return Error{
        fmt::format("the image has {} x {} pixels, the camera {} x {}", width, height, expected.width,
                    expected.height),
        "all images of a folder come from one camera: move the others, or correct its file of intrinsics"};
  const std::uint64_t pixels = std::uint64_t{width} * height;
  if (pixels * sizeof(std::uint16_t) > kMostDeflateRatio * file.size())
    return Error{fmt::format("{} bytes cannot hold {} x {} pixels", file.size(), width, height), kPngRemedy};
  image.width = width;
  image.height = height;
  image.counts.resize(pixels);
  if (!reader.pixels(image.counts.data())) return reader.refused();
  return Done{};
}

// ---- the codec of recordings

namespace {

constexpr std::uint32_t kCameraVersion = 1, kFrameVersion = 1;
/// Version, number, two times, a pose, counts of depths and packed bytes.
constexpr std::size_t kFrameHead = 4 + 8 + 2 * 8 + 7 * 8 + 2 * 4;
constexpr std::size_t kChecksumBytes = 4;
constexpr std::size_t kBytesOfDepth = sizeof(float);
/// A damaged camera may send more than an image, hardly two.
constexpr std::size_t kMostImages = 4;
/// zlib's lowest level. Longer matches than runs take half as much time again and save little.
constexpr int kPackLevel = 1, kStoreLevel = 0;
/// Bits of a byte by its plane's histogram. Below the first, runs pay; between, Huffman's codes alone take a
/// third less time for the same bytes; beyond the second they save a fifth of the image for half its time,
/// and the plane is stored.
constexpr double kRunsBits = 1.2, kStoreBits = 5.0;
/// Every eighth byte gives the histogram.
constexpr std::size_t kHistogramStep = 8;
/// Bytes that zlib adds where its level changes, at most: two blocks' heads.
constexpr std::size_t kPlaneHeadBytes = 64;
constexpr int kWindowBits = 15, kMemoryLevel = 9;

constexpr const char* kDamagedRemedy = "the recording is damaged here: record or copy it again";

std::uint32_t checksum(std::span<const std::byte> bytes) noexcept {
  return static_cast<std::uint32_t>(
      crc32(0, reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
}

/// Small differences of either sign become small numbers.
std::uint32_t zigzag(std::uint32_t difference) noexcept {
  return (difference << 1) ^ (0u - (difference >> 31));
}
/// Bits that a byte of a plane carries.
double bits_a_byte(std::span<const std::uint8_t> plane) {
  std::array<std::uint32_t, 256> counts{};
  double n = 0.0, bits = 0.0;
  for (std::size_t i = 0; i < plane.size(); i += kHistogramStep, n += 1.0) ++counts[plane[i]];
  for (const std::uint32_t count : counts)
    if (count > 0) bits -= count / n * std::log2(count / n);
  return bits;
}
std::uint32_t unzigzag(std::uint32_t code) noexcept {
  return (code >> 1) ^ (0u - (code & 1u));
}

}  // namespace

std::vector<std::byte> encode_camera(const DepthCamera& camera) {
  std::vector<std::byte> bytes(kCameraBytes);
  ByteWriter out{std::span(bytes)};
  out.u32(kCameraVersion);
  out.i32(camera.width);
  out.i32(camera.height);
  for (const double number : {camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px}) out.real(number);
  for (const double number : camera.distortion) out.real(number);
  for (const double number : {camera.period_s, camera.noise_mm, camera.noise_per_mm}) out.real(number);
  out.u32(checksum(std::span(bytes).first(out.size())));
  return bytes;
}

Result<DepthCamera> decode_camera(std::span<const std::byte> bytes) {
  const Error damaged{"the stream's camera is damaged", kDamagedRemedy};
  if (bytes.size() != kCameraBytes) return damaged;
  ByteReader in(bytes);
  const bool known = in.u32() == kCameraVersion;
  DepthCamera camera;
  camera.width = in.i32();
  camera.height = in.i32();
  double sum = 0.0;
  const auto take = [&](double& number) { sum += std::abs(number = in.real()); };
  for (double* number : {&camera.fx_px, &camera.fy_px, &camera.cx_px, &camera.cy_px}) take(*number);
  for (double& number : camera.distortion) take(number);
  for (double* number : {&camera.period_s, &camera.noise_mm, &camera.noise_per_mm}) take(*number);
  if (in.u32() != checksum(bytes.first(kCameraBytes - kChecksumBytes))) return damaged;
  if (!known) return Error{"the stream is of a later version", "read it with the Palpate that recorded it"};
  constexpr int kMostSide = static_cast<int>(kMaxImageSide);
  const bool sized =
      camera.width >= 1 && camera.width <= kMostSide && camera.height >= 1 && camera.height <= kMostSide;
  if (!sized || !std::isfinite(sum) || !(camera.fx_px > 0.0 && camera.fy_px > 0.0 && camera.period_s > 0.0) ||
      !(camera.noise_mm >= 0.0 && camera.noise_per_mm >= 0.0))
    return damaged;
  return camera;
}

/// zlib's two streams, set up once: setting up clears 300 kB.
struct DepthCodec::Packer {
  z_stream deflate{};
  z_stream inflate{};
  bool good = false;

  Packer() {
    good = deflateInit2(&deflate, kPackLevel, Z_DEFLATED, kWindowBits, kMemoryLevel, Z_RLE) == Z_OK &&
           inflateInit(&inflate) == Z_OK;
  }
  ~Packer() {
    deflateEnd(&deflate);
    inflateEnd(&inflate);
  }
  Packer(const Packer&) = delete;
  Packer& operator=(const Packer&) = delete;
};

DepthCodec::DepthCodec(const DepthCamera& camera)
    : width_(static_cast<std::size_t>(camera.width)),
      most_depths_(kMostImages * camera.pixels()),
      packer_(std::make_unique<Packer>()) {}
DepthCodec::~DepthCodec() = default;

void DepthCodec::gather(std::span<const float> depths) {
  const std::size_t n = depths.size();
  codes_.resize(n);
  planes_.resize(n * kBytesOfDepth);
  std::uint32_t* const codes = codes_.data();  // plain loops over local addresses: 4 to 16 at once
  for (std::size_t row = 0; row < n; row += width_) {
    codes[row] = zigzag(std::bit_cast<std::uint32_t>(depths[row]));
    for (std::size_t i = row + 1; i < std::min(n, row + width_); ++i)
      codes[i] =
          zigzag(std::bit_cast<std::uint32_t>(depths[i]) - std::bit_cast<std::uint32_t>(depths[i - 1]));
  }
  for (std::size_t byte = 0; byte < kBytesOfDepth; ++byte) {
    std::uint8_t* const plane = planes_.data() + byte * n;
    for (std::size_t i = 0; i < n; ++i) plane[i] = static_cast<std::uint8_t>(codes[i] >> (8 * byte));
  }
}

void DepthCodec::scatter(std::span<float> depths) const {
  const std::size_t n = depths.size();
  for (std::size_t row = 0; row < n; row += width_) {
    std::uint32_t left = 0;
    for (std::size_t i = row; i < std::min(n, row + width_); ++i) {
      std::uint32_t code = 0;
      for (std::size_t byte = 0; byte < kBytesOfDepth; ++byte)
        code |= static_cast<std::uint32_t>(planes_[byte * n + i]) << (8 * byte);
      left += unzigzag(code);
      depths[i] = std::bit_cast<float>(left);
    }
  }
}

Result<std::span<const std::byte>> DepthCodec::encode(const DepthFrame& frame) {
  if (frame.depth_mm.size() > most_depths_)
    return Error{fmt::format("an image of {} depths is no camera's", frame.depth_mm.size()),
                 "record what the camera gives"};
  z_stream& z = packer_->deflate;
  if (!packer_->good || deflateReset(&z) != Z_OK) return Error{"there is no memory to pack an image"};
  gather(frame.depth_mm);
  packed_.resize(kFrameHead + deflateBound(&z, static_cast<uLong>(planes_.size())) +
                 kBytesOfDepth * kPlaneHeadBytes + kChecksumBytes);
  z.next_out = reinterpret_cast<Bytef*>(packed_.data() + kFrameHead);
  z.avail_out = static_cast<uInt>(packed_.size() - kFrameHead - kChecksumBytes);
  const std::size_t n = frame.depth_mm.size();
  for (std::size_t byte = 0; byte < kBytesOfDepth; ++byte) {
    const std::span<std::uint8_t> plane = std::span(planes_).subspan(byte * n, n);
    const bool last = byte + 1 == kBytesOfDepth;
    z.avail_in = 0;
    const double bits = bits_a_byte(plane);
    const bool set = deflateParams(&z, bits > kStoreBits ? kStoreLevel : kPackLevel,
                                   bits < kRunsBits ? Z_RLE : Z_HUFFMAN_ONLY) == Z_OK;
    z.next_in = plane.data();
    z.avail_in = static_cast<uInt>(n);
    const int packed = ::deflate(&z, last ? Z_FINISH : Z_NO_FLUSH);
    if (!set || z.avail_in != 0 || (last && packed != Z_STREAM_END))
      return Error{"an image could not be packed"};
  }
  ByteWriter head{std::span(packed_)};
  head.u32(kFrameVersion);
  head.u64(frame.number);
  head.real(frame.captured_s);
  head.real(frame.arrived_s);
  const geometry::RigidTransform& pose = frame.world_from_camera;
  for (const double number : {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z()})
    head.real(number);
  head.vec(pose.translation_mm);
  head.u32(static_cast<std::uint32_t>(frame.depth_mm.size()));
  head.u32(static_cast<std::uint32_t>(z.total_out));
  const std::size_t end = kFrameHead + z.total_out;
  ByteWriter tail{std::span(packed_).subspan(end)};
  tail.u32(checksum(std::span(packed_).first(end)));
  return std::span<const std::byte>(packed_).first(end + kChecksumBytes);
}

Status DepthCodec::decode(std::span<const std::byte> bytes, DepthFrame& frame) {
  const Error damaged{"an image of the stream is damaged", kDamagedRemedy};
  if (bytes.size() < kFrameHead + kChecksumBytes ||
      bytes.size() > 2 * most_depths_ * kBytesOfDepth + kFrameHead)
    return damaged;
  ByteReader in(bytes);
  const std::uint32_t version = in.u32();
  frame.number = in.u64();
  frame.captured_s = in.real();
  frame.arrived_s = in.real();
  Eigen::Quaterniond& turn = frame.world_from_camera.rotation;
  for (double* number : {&turn.w(), &turn.x(), &turn.y(), &turn.z()}) *number = in.real();
  frame.world_from_camera.translation_mm = in.vec();
  const std::size_t depths = in.u32(), packed = in.u32();
  const std::span<const std::byte> body = in.raw(packed);
  if (!in.good() || in.left() != kChecksumBytes || depths > most_depths_) return damaged;
  if (in.u32() != checksum(bytes.first(kFrameHead + packed))) return damaged;
  if (version != kFrameVersion)
    return Error{"the stream is of a later version", "read it with the Palpate that recorded it"};
  z_stream& z = packer_->inflate;
  if (!packer_->good || inflateReset(&z) != Z_OK) return Error{"there is no memory to unpack an image"};
  planes_.resize(depths * kBytesOfDepth);
  // zlib wants an address even where nothing comes out.
  std::uint8_t none = 0;
  z.next_in = const_cast<Bytef*>(reinterpret_cast<const Bytef*>(body.data()));  // NOLINT: zlib's old C
  z.avail_in = static_cast<uInt>(body.size());
  z.next_out = planes_.empty() ? &none : planes_.data();
  z.avail_out = static_cast<uInt>(planes_.size());
  if (::inflate(&z, Z_FINISH) != Z_STREAM_END || z.total_out != planes_.size() || z.avail_in != 0)
    return damaged;
  frame.depth_mm.resize(depths);
  scatter(frame.depth_mm);
  return Done{};
}

}  // namespace palpate::stream
