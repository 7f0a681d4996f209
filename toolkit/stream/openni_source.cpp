#include "toolkit/stream/openni_source.h"

#include <dlfcn.h>

#include <array>
#include <filesystem>
#include <vector>

#include "toolkit/core/messages.h"

namespace palpate::stream {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kOpenNiErrorBytes = 512;
constexpr const char* kGetPlugin =
    "build Palpate where libopenni2-dev is installed, and keep palpate_openni.so beside the program or in "
    "its "
    "lib/palpate";

std::vector<std::string> openni_files() {
  std::vector<std::string> files;
  std::error_code none;
  const fs::path folder = fs::read_symlink("/proc/self/exe", none).parent_path();
  for (const fs::path& place : {folder, folder.parent_path() / "lib/palpate", folder.parent_path() / "lib"})
    if (!none && fs::is_regular_file(place / kOpenNiModule, none)) files.push_back(place / kOpenNiModule);
  files.emplace_back(kOpenNiModule);  // the run path, LD_LIBRARY_PATH, the system's folders
  return files;
}

}  // namespace

Result<std::unique_ptr<DepthSource>> open_openni(const std::string& name) {
  const std::string file = openni_files().front();
  void* const module = ::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (module == nullptr) {
    const char* const why = ::dlerror();
    return Error{"OpenNI's cameras need the plug-in " + std::string(kOpenNiModule) + ": " +
                     (why != nullptr ? why : "it cannot be loaded"),
                 kGetPlugin};
  }
  const auto entry = reinterpret_cast<OpenNiEntry>(::dlsym(module, kOpenNiEntry));
  if (entry == nullptr)
    return Error{"is no plug-in for depth cameras", "build it again with this version of Palpate", file};
  std::array<char, kOpenNiErrorBytes> error{};
  std::unique_ptr<DepthSource> source(entry(name.c_str(), error.data(), error.size()));
  if (source != nullptr) return source;
  error.back() = '\0';
  return Error{"the camera " + shown(name) + " cannot be opened: " +
                   (error.front() != '\0' ? error.data() : "the plug-in does not say why"),
               "connect the camera, and close other programs that use it"};
}

}  // namespace palpate::stream
