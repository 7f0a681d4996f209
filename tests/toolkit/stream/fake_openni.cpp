// A plug-in as palpate_openni.so is one, without a camera: "openni" opens, every other name is refused.
#include <cstdio>
#include <cstring>

#include <palpate/depth_stream.h>
#include "toolkit/stream/depth_source.h"

namespace {

class OnePixel final : public palpate::stream::DepthSource {
 public:
  OnePixel() { camera_.width = camera_.height = 1; }
  [[nodiscard]] const palpate::stream::DepthCamera& camera() const noexcept override { return camera_; }
  [[nodiscard]] palpate::Result<bool> next(palpate::stream::DepthFrame& frame) override {
    frame.depth_mm.assign(1, 750.0f);
    return true;
  }
  [[nodiscard]] palpate::Status restart() override { return palpate::Done{}; }
  [[nodiscard]] std::string describe() const override { return "one pixel"; }

 private:
  palpate::stream::DepthCamera camera_;
};

palpate::stream::DepthSource* open_camera(const char* name, char* error, std::size_t size) {
  if (std::strcmp(name, "openni") == 0) return new OnePixel;
  std::snprintf(error, size, "there is no camera %s", name);
  return nullptr;
}

}  // namespace

extern "C" const palpate::stream::OpenNiPlugin* palpate_depth_plugin_entry() {
  using namespace palpate::stream;
  static constexpr OpenNiPlugin kPlugin{kOpenNiAbi, sizeof(OpenNiPlugin), open_camera};
  return &kPlugin;
}
