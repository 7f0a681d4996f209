#include "toolkit/stream/depth_png.h"

#include <fmt/format.h>
#include <png.h>

#include <array>
#include <bit>
#include <csetjmp>
#include <cstring>

namespace palpate::stream {
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

/// What libpng's callbacks reach. Plain data: libpng leaves by longjmp, which runs no destructor.
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

}  // namespace palpate::stream
