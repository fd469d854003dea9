// Sets `folded` to atan(|over|/under) for under > 0, by `over` and `under` of the type `real`, which vectorises. The quotient is
// folded into [-tan(pi/8), tan(pi/8)] before the one division.
const real a = over < real(0) ? -over : over;
const real steep = a > real(2.414213562373095) * under ? real(1) : real(0);
const real middle = (a > real(0.4142135623730951) * under ? real(1) : real(0)) - steep;
const real top = steep > real(0) ? -under : (middle > real(0) ? a - under : a);
const real bottom = steep > real(0) ? a : (middle > real(0) ? a + under : under);
const real x = top / (bottom > real(1e-12) ? bottom : real(1e-12));
const real z = x * x;
// atan(x)/x in powers of x^2 on |x| <= tan(pi/8): interpolation at Chebyshev nodes; errors 6e-10 and below 1e-16
real series;
if (sizeof(real) == 4) {
    series = (real(0.9999999993712282) +
              z *
                  (real(-0.33333306893048514) +
                   z *
                       (real(0.19998183041083206) +
                        z * (real(-0.14239532669648974) + z * (real(0.10569828806414448) + z * real(-0.06026305227658459))))));
} else {
    series =
        (real(1.0) +
         z *
             (real(-0.3333333333333312) +
              z *
                  (real(0.19999999999940893) +
                   z *
                       (real(-0.14285714279250245) +
                        z *
                            (real(0.11111110744919658) +
                             z *
                                 (real(-0.09090896809064027) +
                                  z *
                                      (real(0.07692045330902225) +
                                       z *
                                           (real(-0.06662951813629191) +
                                            z *
                                                (real(0.05846878297330872) +
                                                 z *
                                                     (real(-0.05035102456601552) +
                                                      z * (real(0.03796525745386593) + z * real(-0.017805397205419446))))))))))));
}
const real folded = x * series + middle * real(0.7853981633974483) + steep * real(1.5707963267948966);
