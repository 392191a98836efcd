#include "ax.hpp"
#include <cstdio>
int main(){ax::Axis<double> a; ax::Axis<float> b; for(int k=0;k<10;k++) printf("%g %g\n",a.compensate(k*1e-3,0,1e-3,0), (double)b.friction(k*1e-3f,0,1e-3f,0,0));}
