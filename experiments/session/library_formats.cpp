#include "experiments/session/session.h"

#include <dlfcn.h>
#include <fmt/format.h>

// Their headers alone: the libraries are the module's.
#include <palpate/read_model.h>
#include "toolkit/io/decoded_file.h"

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

[[maybe_unused]] void add_lazily(io::Readers& readers, const char* extension) {
  readers.add({extension}, [extension](const io::ReaderInput& input) -> Result<io::DecodedFile> {
    static const Result<io::Readers> loaded = load();
    if (!loaded) return loaded.error();
    return (*loaded->find(extension))(input);
  });
}

}  // namespace

void add_library_formats([[maybe_unused]] io::Readers& readers) {
#ifdef PALPATE_WITH_PCD
  add_lazily(readers, pcd::kPcdExtension);
#endif
#ifdef PALPATE_WITH_DEM
  for (const char* extension : dem::kDemExtensions) add_lazily(readers, extension);
#endif
}

}  // namespace palpate::experiments
