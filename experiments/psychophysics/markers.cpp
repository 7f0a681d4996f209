#include "experiments/psychophysics/markers.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cstdint>

#include <palpate/result.h>
#include "toolkit/core/message_text.h"

namespace palpate::experiments::psychophysics {
namespace {

// The C interface of liblsl, from its public headers (lsl/streaminfo.h, lsl/outlet.h, lsl/common.h of version
// 1.14): handles are opaque pointers, a format is a four-byte enumeration, push returns 0 or an error code
// below it.
struct LslInfoBody;
struct LslOutletBody;
using LslInfo = LslInfoBody*;
using LslOutlet = LslOutletBody*;
constexpr std::int32_t kLslText = 3;      // cft_string
constexpr double kLslIrregular = 0.0;     // LSL_IRREGULAR_RATE
constexpr std::int32_t kLslBuffer = 360;  // seconds, or hundreds of an irregular stream's samples

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
    // A mark that fails to go out is ignored; the trial continues.
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
  // The library stays loaded: its threads may outlive its objects.
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
