#include "toolkit/stream/openni_source.h"

#include <array>
#include <filesystem>
#include <utility>
#include <vector>

#include "toolkit/core/messages.h"
#include "toolkit/core/plugin_module.h"

namespace palpate::stream {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kOpenNiErrorBytes = 512;
constexpr const char* kGetPlugin =
    "build Palpate where libopenni2-dev is installed, and keep palpate_openni.so in lib/palpate/plugins "
    "beside the program's bin, or in a folder of PALPATE_PLUGINS";

fs::path openni_file() {
  std::error_code missing;
  for (const fs::path& folder : plugin_folders())
    if (fs::is_regular_file(folder / kOpenNiModule, missing)) return folder / kOpenNiModule;
  return kOpenNiModule;  // the run path, LD_LIBRARY_PATH, the system's folders
}

using LoadedOpenNi = std::shared_ptr<const OpenNiPlugin>;

/// Loads it once. It is never unloaded: its drivers' threads may outlast every camera.
Result<LoadedOpenNi> load_openni() {
  static LoadedOpenNi& kept = *new LoadedOpenNi();
  if (kept == nullptr) {
    PALPATE_ASSIGN(LoadedOpenNi loaded, load_plugin<OpenNiPlugin>(openni_file(), kOpenNiEntry, kOpenNiAbi));
    if (loaded->open == nullptr) return not_of_this_version(openni_file());
    kept = std::move(loaded);
  }
  return kept;
}

}  // namespace

Result<std::unique_ptr<DepthSource>> open_openni(const std::string& name) {
  const Result<LoadedOpenNi> plugin = load_openni();
  if (!plugin)
    return Error{
        "OpenNI's cameras need the plug-in " + std::string(kOpenNiModule) + ": " + plugin.error().what,
        kGetPlugin};
  std::array<char, kOpenNiErrorBytes> error{};
  std::unique_ptr<DepthSource> source((*plugin)->open(name.c_str(), error.data(), error.size()));
  if (source != nullptr) return source;
  error.back() = '\0';
  return Error{"the camera " + shown(name) + " cannot be opened: " +
                   (error.front() != '\0' ? error.data() : "the plug-in does not say why"),
               "connect the camera, and close other programs that use it"};
}

}  // namespace palpate::stream
