#include "toolkit/core/plugin_module.h"

#include <dlfcn.h>

#include <algorithm>
#include <cstdlib>
#include <map>
#include <system_error>

#include <palpate/options.h>

namespace palpate {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kModuleEnding = ".so";

}  // namespace

std::vector<fs::path> plugin_folders() {
  std::vector<fs::path> folders;
  if (const char* named = std::getenv("PALPATE_PLUGINS"))
    for (const std::string& folder : split_list(named, ':'))
      if (!folder.empty()) folders.emplace_back(folder);
  std::error_code none;
  const fs::path program = fs::read_symlink("/proc/self/exe", none);
  if (!none) folders.push_back(program.parent_path().parent_path() / "lib/palpate/plugins");
  return folders;
}

std::vector<PluginFile> plugin_files(std::string_view prefix) {
  std::map<std::string, fs::path> files;
  std::error_code none, unreadable;
  for (const fs::path& folder : plugin_folders()) {
    fs::directory_iterator it(folder, none);
    for (const fs::directory_iterator end; !none && it != end; it.increment(none)) {
      const std::string file = it->path().filename().string();
      if (file.size() <= prefix.size() + kModuleEnding.size() || !file.starts_with(prefix) ||
          !file.ends_with(kModuleEnding) || !fs::is_regular_file(it->path(), unreadable))
        continue;
      files.try_emplace(file.substr(prefix.size(), file.size() - prefix.size() - kModuleEnding.size()),
                        it->path());
    }
    none.clear();
  }
  std::vector<PluginFile> found;
  for (auto& [name, file] : files) found.push_back({name, file});
  return found;
}

Error not_of_this_version(const fs::path& file) {
  return {"is no plug-in of this version", "build it again with this version of Palpate", file.string()};
}

Result<std::shared_ptr<void>> load_module(const fs::path& file) {
  std::shared_ptr<void> module(::dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL), [](void* handle) {
    if (handle != nullptr) ::dlclose(handle);
  });
  if (module != nullptr) return module;
  const char* const why = ::dlerror();
  return Error{std::string("the plug-in cannot be loaded: ") + (why != nullptr ? why : "no reason told"),
               "install the library that it names, or tell the loader where it is (LD_LIBRARY_PATH)",
               file.string()};
}

void* exported(void* module, const char* name) noexcept {
  return ::dlsym(module, name);
}

}  // namespace palpate
