function [value, sd] = fit_tfsrivc(t, u, position, detrended)
% FIT_TFSRIVC  CONTSID's SRIVC with one pole and no zero on the speed; the rest as in FIT_TFEST. Not run under MATLAB.
sample_time = t(2) - t(1);
data = iddata(diff(position) / sample_time, u(2:end), sample_time, 'InterSample', 'zoh');
if detrended
    data = detrend(data, 0);
end
model = tfsrivc(data, 1, 0, sample_time / 2, 'FixTd', 'on');
[value, sd] = first_order(model);
end
