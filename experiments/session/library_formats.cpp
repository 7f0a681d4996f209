#include "experiments/session/library_formats.h"

#include <dlfcn.h>
#include <fmt/format.h>

namespace palpate::experiments {
namespace {

constexpr const char* kModule = "palpate-formats.so";
constexpr const char* kEntry = "palpate_add_formats";

Result<io::Readers> load() {
  // Never closed: readers of its own live as long as the program.
  void* const module = dlopen(kModule, RTLD_NOW | RTLD_LOCAL);
  void* const entry = module == nullptr ? nullptr : dlsym(module, kEntry);
  if (entry == nullptr) {
    const char* const why = dlerror();
    return Error{
        fmt::format("this format's libraries cannot be loaded: {}", why == nullptr ? "no entry" : why),
        "install Palpate's lib folder beside its bin folder, and the packages of cmake/packages.txt",
        {},
        0};
  }
  io::Readers readers;
  reinterpret_cast<void (*)(io::Readers&)>(entry)(readers);
  return readers;
}

Result<io::DecodedFile> read_by_module(const io::ReaderInput& input, const char* extension) {
  static const Result<io::Readers> loaded = load();
  if (!loaded) return loaded.error();
  return (*loaded->find(extension))(input);
}

}  // namespace

void add_library_formats(io::Readers& readers) {
  for (const char* extension : {
#ifdef PALPATE_WITH_PCD
           "pcd",
#endif
#ifdef PALPATE_WITH_DEM
           "tif",
           "tiff",
           "png",
           "hgt",
           "dem",
           "asc",
           "zip",
#endif
       })
    readers.add({extension},
                [extension](const io::ReaderInput& input) { return read_by_module(input, extension); });
}

}  // namespace palpate::experiments
