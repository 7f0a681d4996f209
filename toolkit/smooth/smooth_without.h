// Steps of the making of a smooth surface that can be left out, to measure what each is worth. Nobody feels
// such a surface otherwise: the renderer has no option for it.
#pragma once

namespace palpate::render {

struct SmoothWithout {
  bool places = false;      ///< the noise of all places is one
  bool robust = false;      ///< every point of a ball counts in a fit, however far off
  bool known = false;       ///< a first fit may take more for noise than is known to be there
  bool agreement = false;   ///< fits grow to 6.2 spacings whether they agree with smaller ones or not
  bool growth = false;      ///< fits keep their first radius, 2.2 spacings
  bool separation = false;  ///< another sheet's points in a ball have their say
  bool folds = false;       ///< patches over a crease stay
  bool strays = false;      ///< what stands alone is surface, too
  bool beside = false;      ///< small patches beside a surface that is known there stay
  bool creases = false;     ///< no ridges and valleys: all is blended
  bool sheets = false;      ///< all patches of a cube are one sheet
  bool trust = false;       ///< patches count alike, however well they are known
  bool blend = false;       ///< at each node the patch that counts most, alone
  bool layers = false;      ///< faces that meet in a crease are joined before the spline, which rounds it
  bool seams = false;       ///< a step of curvature is blended as everything else
  bool sharpening = false;  ///< what the spline blurs stays blurred
  bool borders = false;     ///< surface where no points are around
  bool enclosure = false;   ///< closed pieces with holes are felt from both sides
  // Of a frame.
  bool hessian = false;   ///< the god object's steps go as far along the tangent plane as the HIP is
  bool settling = false;  ///< let go once the HIP is above the tangent plane, settled or not
  bool clearing = false;  ///< let go without asking the sheet's own distance

  friend bool operator==(const SmoothWithout&, const SmoothWithout&) = default;
};

}  // namespace palpate::render
