#include "experiments/psychophysics/markers.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cstdint>

#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments::psychophysics {
namespace {

// The C interface of liblsl, by its public headers (lsl/streaminfo.h, lsl/outlet.h, lsl/common.h of version
// 1.14): handles are pointers to what is not told, a format is an enumeration of four bytes, and answers of
// push are 0 or a code below it.
struct LslInfoBody;
struct LslOutletBody;
using LslInfo = LslInfoBody*;
using LslOutlet = LslOutletBody*;
constexpr std::int32_t kLslText = 3;      // cft_string
constexpr double kLslIrregular = 0.0;     // LSL_IRREGULAR_RATE
constexpr std::int32_t kLslBuffer = 360;  // seconds, or hundreds of samples of an irregular stream

struct LslFunctions {
  LslInfo (*create_streaminfo)(const char*, const char*, std::int32_t, double, std::int32_t, const char*);
  LslOutlet (*create_outlet)(LslInfo, std::int32_t, std::int32_t);
  std::int32_t (*push_sample)(LslOutlet, const char**, double);
  double (*local_clock)();
  void (*destroy_outlet)(LslOutlet);
  void (*destroy_streaminfo)(LslInfo);
};

struct LibraryCloser {
  void operator()(void* handle) const noexcept { dlclose(handle); }
};
using Library = std::unique_ptr<void, LibraryCloser>;

template <class Function>
Status find_in(const Library& library, const char* name, const std::string& file, Function*& function) {
  function = reinterpret_cast<Function*>(dlsym(library.get(), name));
  if (function != nullptr) return Done{};
  return Error{fmt::format("the library has no function {}", name), "install liblsl 1.13 or newer", file, 0};
}

class LslMarkers final : public Markers {
 public:
  LslMarkers(Library library, const LslFunctions& lsl, LslInfo info, LslOutlet outlet) noexcept
      : library_(std::move(library)), lsl_(lsl), info_(info), outlet_(outlet) {}
  ~LslMarkers() override {
    lsl_.destroy_outlet(outlet_);
    lsl_.destroy_streaminfo(info_);
  }
  void push(const std::string& text, double seconds_ago) override {
    const char* const sample = text.c_str();
    const char* samples[] = {sample};
    // Nobody is there to do anything about a mark that does not go out; the trial goes on.
    (void)lsl_.push_sample(outlet_, samples, lsl_.local_clock() - seconds_ago);
  }

 private:
  Library library_;
  LslFunctions lsl_;
  LslInfo info_;
  LslOutlet outlet_;
};

}  // namespace

Result<std::unique_ptr<Markers>> lsl_markers(const std::string& library, const std::string& source) {
  // It has threads of its own, which may still be on their way out when its objects are gone: it stays.
  Library opened(dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL | RTLD_NODELETE));
  if (!opened) {
    const char* const why = dlerror();
    return Error{fmt::format("Lab Streaming Layer is not there: {}", why == nullptr ? "no library" : why),
                 "install liblsl, or name its file with --lsl-library", library, 0};
  }
  LslFunctions lsl{};
  PALPATE_TRY(find_in(opened, "lsl_create_streaminfo", library, lsl.create_streaminfo));
  PALPATE_TRY(find_in(opened, "lsl_create_outlet", library, lsl.create_outlet));
  PALPATE_TRY(find_in(opened, "lsl_push_sample_strt", library, lsl.push_sample));
  PALPATE_TRY(find_in(opened, "lsl_local_clock", library, lsl.local_clock));
  PALPATE_TRY(find_in(opened, "lsl_destroy_outlet", library, lsl.destroy_outlet));
  PALPATE_TRY(find_in(opened, "lsl_destroy_streaminfo", library, lsl.destroy_streaminfo));
  LslInfo const info =
      lsl.create_streaminfo("Palpate", "Markers", 1, kLslIrregular, kLslText, source.c_str());
  LslOutlet const outlet = info == nullptr ? nullptr : lsl.create_outlet(info, 0, kLslBuffer);
  if (outlet == nullptr) {
    if (info != nullptr) lsl.destroy_streaminfo(info);
    return Error{"Lab Streaming Layer opens no stream", "look at what its library says", library, 0};
  }
  return std::unique_ptr<Markers>(std::make_unique<LslMarkers>(std::move(opened), lsl, info, outlet));
}

}  // namespace palpate::experiments::psychophysics
