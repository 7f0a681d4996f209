// The plug-in palpate_openni.so: depth cameras of OpenNI2 as a source of depth images.
//
// Depths come in mm and the intrinsics from the field of view, for OpenNI tells no lens. The image's time is
// the device's stamp. Device and machine have clocks of their own: the image that came soonest after its
// stamp says how far they are apart, so an arrival counts what an image took longer than that one.
#include <OpenNI.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <utility>

#include <palpate/clock.h>
#include <palpate/depth_stream.h>
#include <palpate/result.h>
#include "toolkit/stream/depth_source.h"

namespace palpate::stream {
namespace {

/// A camera that is silent so long is taken to be gone: cameras start within 2 s, and send 30 images a
/// second.
constexpr int kSilentMs = 5000;
constexpr double kSPerUs = 1e-6;
constexpr double kMmPerTenthMm = 0.1;

/// Starts the library once. It is never ended: its shutdown unloads drivers whose threads may still run.
bool library_runs() {
  static const bool kRuns = openni::OpenNI::initialize() == openni::STATUS_OK;
  return kRuns;
}

/// OpenNI's last message on one line.
std::string openni_error() {
  std::string text = openni::OpenNI::getExtendedError();
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '\n' || c == '\t' || c == '\r'; }, ' ');
  text.erase(text.find_last_not_of(' ') + 1);
  return text.empty() ? "OpenNI2 does not say why" : text;
}

class OpenNiSource final : public DepthSource {
 public:
  ~OpenNiSource() override {
    depth_.stop();
    depth_.destroy();
    device_.close();
  }

  /// Empty, or why the camera cannot be used.
  [[nodiscard]] std::string open(std::string_view name) {
    if (!library_runs()) return "OpenNI2 does not start: " + openni_error();
    std::string where;
    if (std::string why = find(name, where); !why.empty()) return why;
    if (device_.open(where.c_str()) != openni::STATUS_OK) return openni_error();
    if (!device_.hasSensor(openni::SENSOR_DEPTH)) return "it measures no depth";
    if (depth_.create(device_, openni::SENSOR_DEPTH) != openni::STATUS_OK) return openni_error();
    (void)depth_.setMirroringEnabled(false);  // where it cannot be switched, there is none
    const openni::VideoMode mode = depth_.getVideoMode();
    switch (mode.getPixelFormat()) {
      case openni::PIXEL_FORMAT_DEPTH_1_MM:
        break;
      case openni::PIXEL_FORMAT_DEPTH_100_UM:
        unit_mm_ = kMmPerTenthMm;
        break;
      default:
        return "its depths are in a format that is not known";
    }
    camera_.width = mode.getResolutionX();
    camera_.height = mode.getResolutionY();
    const auto across = static_cast<double>(depth_.getHorizontalFieldOfView()),
               down = static_cast<double>(depth_.getVerticalFieldOfView());
    if (camera_.width <= 0 || camera_.height <= 0) return "its images are empty";
    camera_.cx_px = 0.5 * (camera_.width - 1);
    camera_.cy_px = 0.5 * (camera_.height - 1);
    if (!(across > 0.0)) return "it does not tell its field of view";
    camera_.fx_px = 0.5 * camera_.width / std::tan(0.5 * across);
    camera_.fy_px = down > 0.0 ? 0.5 * camera_.height / std::tan(0.5 * down) : camera_.fx_px;
    if (mode.getFps() > 0) camera_.period_s = 1.0 / mode.getFps();
    const openni::DeviceInfo& device = device_.getDeviceInfo();
    described_ = std::string(device.getVendor()) + " " + device.getName();
    // Last: what is refused has started no thread, which some drivers let run on after stop().
    return depth_.start() == openni::STATUS_OK ? std::string() : openni_error();
  }

  [[nodiscard]] const DepthCamera& camera() const noexcept override { return camera_; }
  [[nodiscard]] Result<bool> next(DepthFrame& frame) override {
    openni::VideoStream* streams[] = {&depth_};
    int ready = -1;
    if (openni::OpenNI::waitForAnyStream(streams, 1, &ready, kSilentMs) != openni::STATUS_OK)
      return Error{described_ + " has sent no image for " + std::to_string(kSilentMs / 1000) + " s",
                   "look at its cable, and close other programs that use it",
                   {},
                   0};
    openni::VideoFrameRef image;
    if (depth_.readFrame(&image) != openni::STATUS_OK || !image.isValid())
      return Error{described_ + ": " + openni_error(), "look at its cable", {}, 0};
    if (image.getWidth() != camera_.width || image.getHeight() != camera_.height)
      return Error{described_ + " has changed the size of its images", "open it again", {}, 0};
    stamp(image, frame);
    const auto* rows = static_cast<const unsigned char*>(image.getData());
    frame.depth_mm.resize(camera_.pixels());
    std::size_t pixel = 0;
    for (int row = 0; row < camera_.height; ++row, rows += image.getStrideInBytes()) {
      const auto* depths = reinterpret_cast<const openni::DepthPixel*>(rows);
      for (int column = 0; column < camera_.width; ++column)
        frame.depth_mm[pixel++] = static_cast<float>(unit_mm_ * depths[column]);
    }
    return true;
  }
  [[nodiscard]] Status restart() override { return Done{}; }
  [[nodiscard]] std::string describe() const override { return described_; }

 private:
  /// Finds the address of "openni", the first camera, or "openni:N", the one of this number. Any other
  /// "openni:ADDRESS" is for OpenNI's drivers, of which one opens recordings (.oni).
  [[nodiscard]] static std::string find(std::string_view name, std::string& where) {
    std::size_t wanted = 0;
    if (name != kOpenNiName) {
      if (!name.starts_with(kOpenNiPrefix) || name.size() == kOpenNiPrefix.size())
        return "no name of a camera: openni is the first one, openni:1 the second";
      name.remove_prefix(kOpenNiPrefix.size());
      const char* const last = name.data() + name.size();
      if (std::from_chars(name.data(), last, wanted).ptr != last) {
        where = name;
        return {};
      }
    }
    openni::Array<openni::DeviceInfo> devices;
    openni::OpenNI::enumerateDevices(&devices);
    const auto count = static_cast<std::size_t>(devices.getSize());
    if (wanted >= count)
      return count == 0 ? "there is no camera" : "there are only " + std::to_string(count) + " cameras";
    where = devices[static_cast<int>(wanted)].getUri();
    return {};
  }

  /// Number and times, from the first image on.
  void stamp(const openni::VideoFrameRef& image, DepthFrame& frame) {
    const double device_s = kSPerUs * static_cast<double>(image.getTimestamp());
    const double machine_s = clock_.now_s();
    if (!any_) first_device_s_ = device_s;
    any_ = true;
    frame.captured_s = device_s - first_device_s_;
    apart_s_ = std::min(apart_s_, machine_s - frame.captured_s);
    frame.arrived_s = std::max(frame.captured_s, machine_s - apart_s_);
    // Its number is the device's, in which lost images show; drivers that count none repeat one.
    const auto number = static_cast<std::uint64_t>(std::max(0, image.getFrameIndex()));
    number_ = number > number_ ? number : number_ + 1;
    frame.number = number_;
    frame.world_from_camera = {};
  }

  openni::Device device_;
  openni::VideoStream depth_;
  DepthCamera camera_;
  double unit_mm_ = 1.0;
  std::string described_;
  MonotonicClock clock_;
  bool any_ = false;
  double first_device_s_ = 0.0;
  double apart_s_ =
      std::numeric_limits<double>::infinity();  ///< machine's clock less the device's, the least
  std::uint64_t number_ = 0;
};

DepthSource* open_camera(const char* name, char* error, std::size_t size) {
  std::string why;
  try {
    auto source = std::make_unique<OpenNiSource>();
    why = source->open(name);
    if (why.empty()) return source.release();
  } catch (const std::exception& thrown) {
    why = thrown.what();
  }
  if (size > 0) std::snprintf(error, size, "%s", why.c_str());
  return nullptr;
}

}  // namespace
}  // namespace palpate::stream

extern "C" __attribute__((visibility("default"))) const palpate::stream::OpenNiPlugin*
palpate_depth_plugin_entry() {
  using namespace palpate::stream;
  static constexpr OpenNiPlugin kPlugin{kOpenNiAbi, sizeof(OpenNiPlugin), open_camera};
  return &kPlugin;
}
