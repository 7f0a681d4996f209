// Fuzzes texts of the Inverse3's service: accepted positions are finite, and sent texts are
// valid with finite forces.
#include <cstdint>
#include <string>
#include <string_view>

#include "device/haply/inverse3_device.h"
#include "tests/fuzz/must.h"

extern "C" int palpate_fuzz_inverse3(const std::uint8_t* data, std::size_t size) {
  using namespace palpate::device;
  using palpate::must;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const Inverse3Text read = parsed_inverse3(text, "");
  must(palpate::is_finite(read.position_mm) && (read.has_position || read.position_mm.isZero(0.0)));
  must(!read.has_device || read.is_json);
  const palpate::VirtualClock clock;
  Inverse3Session talk(clock, "", 0.3);
  talk.take(text);
  must(talk.present() == (read.has_device && read.has_position));
  talk.force(palpate::Vec3{1.0, -2.0, 0.5});
  std::string sent;
  for (int i = 0; i < 3; ++i)
    if (talk.give(sent)) must(sent.starts_with("{\"inverse3\":[{") && sent.ends_with("}]}"));
  if (talk.last(sent))
    must(sent.find(R"("set_cursor_force":{"values":{"x":0.0,"y":0.0,"z":0.0}})") != std::string::npos);
  return 0;
}

#ifdef PALPATE_FUZZING
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  return palpate_fuzz_inverse3(data, size);
}
#endif
