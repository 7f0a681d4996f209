// Steps of the making of a star mesh that can be left out, to measure what each is worth. Nobody feels such a
// mesh otherwise: but for the raster no renderer has an option for it.
#pragma once

namespace palpate::stars {

struct StarsWithout {
  bool borders = false;    ///< triangles may be of any size, and loops of any length are filled
  bool crossings = false;  ///< sheets that cross are not looked for
  bool flat = false;       ///< no flat stars in noise
  bool mending = false;    ///< stars stay as they were laid out at first
  bool filling = false;    ///< what not all three stars of a triangle have stays open
  bool enclosure = false;  ///< pieces with holes are felt from both sides, whatever they enclose
  bool raster = false;     ///< stars are never read from the rows and columns of a scan
  bool remaking = false;   ///< where sides do not agree nothing is made anew

  friend bool operator==(const StarsWithout&, const StarsWithout&) = default;
};

}  // namespace palpate::stars
